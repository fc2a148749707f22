"""Plausibility of a typed f-number, from the PSF of the photograph. Pure.

Far from its centre the PSF of any lens falls as a / r^3, where a depends on the f-number alone, not on aberrations
(`Diffraction.tail_density_px`): the far tail gives an estimate of the f-number. An MTF above the diffraction limit
shows an f-number that is too large. Scattered light, as of a dirty lens, raises the tail to that of a larger f-number,
so the operator may insist.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from procedures.outcome import Quantity, verdict_of
from procedures.pattern_psf.estimate import PUPIL_SPREAD, PatternPsf, estimate_psf
from procedures.pattern_psf.facts import PatternFacts
from procedures.pattern_psf.refine import TailPrior
from procedures.plan import Advice, Facts, Reading, facts_as
from procedures.psf import Psf
from procedures.quality import Diffraction, beyond_diffraction
from procedures.raw import RawFrame

KEY = "typed_f_number"
CONTRADICTION_SIGMAS = 3.0
"""Standard uncertainties between the typed f-number and that of the far tail above which one of them is wrong."""


def check_aperture(frame: RawFrame, facts: Facts) -> Advice:
    """Compare the typed f-number with the far tails of the planes' PSFs and with the diffraction limit."""
    known = facts_as(PatternFacts, facts)
    typed = known.typed_f_number
    if typed is None or frame.exposure.f_number is not None:
        return Advice(True, "The camera records its f-number.")
    psfs = [
        (one.value, limit)
        for plane in frame.planes.values()
        if (limit := known.diffraction(plane)) is not None
        and (one := estimate_psf(plane, known.chart, known.quick_parameters)).value is not None
    ]
    estimated = f_number_of_tails(psfs)
    if estimated is None:
        return Advice(True, f"f/{typed:g} is used without verification: no PSF could be estimated.")
    apart = CONTRADICTION_SIGMAS * float(np.hypot(estimated.uncertainty, PUPIL_SPREAD * typed))
    reading = Reading("f-number by the far tail", estimated.value, "", typed - apart, typed + apart)
    noted = {"tail_f_number": estimated.value, "tail_f_number_uncertainty": estimated.uncertainty}
    contradiction = _contradiction(reading, estimated, typed, psfs)
    if contradiction and KEY not in known.insisted:
        return Advice(False, contradiction, (reading,), facts=noted, contradictory=(KEY,))
    say = f"The far tail of the PSF corresponds to f/{_words(estimated)}; f/{typed:g} was given."
    return Advice(True, say, (replace(reading, low=None, high=None),), facts=noted)


def f_number_of_tails(psfs: Sequence[tuple[PatternPsf, Diffraction]]) -> Quantity | None:
    """Estimate the f-number from far tails; None without any PSF.

    psfs : PSFs whose far tail was fitted without any f-number, each with its plane's pitch and wavelength

    Returns
    -------
    Quantity or None
        Mean over the PSFs, weighted by their noise. Its uncertainty covers noise alone, enlarged where the PSFs scatter
        more; non-circular pupils and the spread of wavelengths add the relative uncertainty `PUPIL_SPREAD`.
    """
    if not psfs:
        return None
    noise = [max(one.residual_std, 1.0) for one, _ in psfs]
    mean, uncertainty = mean_f_number([(one.psf, limit) for one, limit in psfs], noise)
    return Quantity(mean, "1", uncertainty, "far tail of the PSF over that of f/1", sum(psf.n for psf, _ in psfs))


def mean_f_number(psfs: Sequence[tuple[Psf, Diffraction]], noise: Sequence[float] | None = None) -> tuple[float, float]:
    """The f-number of the far tails of PSFs and its standard uncertainty, as `f_number_of_tails`.

    noise : factor of each PSF's stated uncertainty; 1 by default
    """
    factors = noise or [1.0] * len(psfs)
    value, u = np.array([_f_number_of_tail(*psf, k) for psf, k in zip(psfs, factors, strict=True)]).T
    weight = 1 / u**2
    mean = float(weight @ value / weight.sum())
    scatter = float(weight @ (value - mean) ** 2) / max(len(value) - 1, 1)
    return mean, float(np.sqrt(max(scatter, 1.0) / weight.sum()))


def _f_number_of_tail(psf: Psf, limit: Diffraction, noise: float) -> tuple[float, float]:
    """Estimate the f-number, the tail's energy over that of f/1, with its standard uncertainty by noise."""
    energy_of_f1 = TailPrior(replace(limit, f_number=1.0).tail_density_px, PUPIL_SPREAD).energy(psf.s, psf.k)
    u = float(np.sqrt(psf.tail.covariance[0, 0])) * noise
    return float(psf.tail.amplitudes[0]) / energy_of_f1, u / energy_of_f1


def _contradiction(
    reading: Reading, estimated: Quantity, typed: float, psfs: Sequence[tuple[PatternPsf, Diffraction]]
) -> str:
    """Sentence on what contradicts the f-number; empty where nothing does."""
    if not reading.good:
        return (
            f"The far tail of the PSF corresponds to f/{_words(estimated)}, but f/{typed:g} was given. Correct the "
            "f-number, or clean the lens: scattered light imitates a larger f-number."
        )
    beyond = verdict_of(check for psf, limit in psfs for check in beyond_diffraction(psf.quality, limit)).reason
    return f"{beyond[0].upper()}{beyond[1:]}: the f-number that was given is too large." if beyond else ""


def _words(estimated: Quantity) -> str:
    return f"{estimated.value:.1f} ± {np.hypot(estimated.uncertainty, PUPIL_SPREAD * estimated.value):.1f}"
