"""Whether an f-number that was typed can be true: held against the photograph's own PSF. Pure.

Far from its centre any lens's PSF falls as a / r^3, and a goes with the f-number alone, whatever the aberrations
(`Diffraction.tail_density_px`): the far tail tells the f-number from both sides. No MTF can be higher than diffraction
lets it be either, which tells one that is too large. Light that is scattered, as by a dirty lens, makes the tail that
of a larger f-number: who is sure may insist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.facts import facts_as
from procedures.outcome import Quantity, verdict_of
from procedures.pattern_psf.estimate import PUPIL_SPREAD, PatternPsf, estimate_psf
from procedures.pattern_psf.facts import PatternFacts
from procedures.pattern_psf.refine import TailPrior
from procedures.plan import Advice, Facts, Reading
from procedures.quality import Diffraction, beyond_diffraction
from procedures.raw import RawFrame

Array = npt.NDArray[np.float64]
KEY = "typed_f_number"
SURE = 3.0
"""Standard uncertainties between the f-number typed and that of the far tail, from which one of them is wrong."""


def check_aperture(frame: RawFrame, facts: Facts) -> Advice:
    """The f-number that was typed, against the far tails of the planes' PSFs and what diffraction lets pass."""
    known = facts_as(PatternFacts, facts)
    typed = known.typed_f_number
    if typed is None or frame.exposure.f_number is not None:
        return Advice(True, "The camera notes its f-number.")
    found = [
        (one.value, limit)
        for plane in frame.planes.values()
        if (limit := known.diffraction(plane)) is not None
        and (one := estimate_psf(plane, known.chart, known.quick_parameters)).value is not None
    ]
    told = f_number_of_tails(found)
    if told is None:
        return Advice(True, f"f/{typed:g} is taken on your word: no PSF is found that tells it.")
    apart = SURE * float(np.hypot(told.uncertainty, PUPIL_SPREAD * typed))
    reading = Reading("f-number by the far tail", told.value, "", typed - apart, typed + apart)
    noted = {"tail_f_number": told.value, "tail_f_number_uncertainty": told.uncertainty}
    contradiction = _contradiction(reading, told, typed, found)
    if contradiction and KEY not in known.insisted:
        return Advice(False, contradiction, (reading,), facts=noted, doubted=(KEY,))
    say = f"By the far tail of its PSF the lens is at f/{_words(told)}; f/{typed:g} was given."
    return Advice(True, say, (replace(reading, low=None, high=None),), facts=noted)


def f_number_of_tails(found: Sequence[tuple[PatternPsf, Diffraction]]) -> Quantity | None:
    """The f-number that far tails tell; None of no PSF.

    Parameters
    ----------
    found : PSFs whose far tail was fitted without any f-number, each with its plane's pitch and wavelength

    Returns
    -------
    Quantity or None
        Mean of the PSFs, weighted by their noise. Its uncertainty is noise alone, raised where they scatter more than
        by it; what pupils that are no circles and a colour's spread of wavelengths add is `PUPIL_SPREAD` of it.
    """
    if not found:
        return None
    value, u = np.array([_of_tail(psf, limit) for psf, limit in found]).T
    weight = 1 / u**2
    mean = float(weight @ value / weight.sum())
    scatter = float(weight @ (value - mean) ** 2) / max(len(value) - 1, 1)
    uncertainty = float(np.sqrt(max(scatter, 1.0) / weight.sum()))
    return Quantity(mean, "1", uncertainty, "far tail of the PSF over that of f/1", sum(psf.n for psf, _ in found))


def _of_tail(found: PatternPsf, limit: Diffraction) -> tuple[float, float]:
    """The f-number and its standard uncertainty by noise: the tail's energy over that which f/1 would leave."""
    psf = found.psf
    of_one = TailPrior(replace(limit, f_number=1.0).tail_density_px, PUPIL_SPREAD).energy(psf.s, psf.k)
    u = float(np.sqrt(psf.tail.covariance[0, 0])) * max(found.residual_std, 1.0)
    return float(psf.tail.amplitudes[0]) / of_one, u / of_one


def _contradiction(
    reading: Reading, told: Quantity, typed: float, found: Sequence[tuple[PatternPsf, Diffraction]]
) -> str:
    """What contradicts the f-number, a sentence; "" where nothing does."""
    if not reading.good:
        return (
            f"By the far tail of its PSF the lens is at f/{_words(told)}, and f/{typed:g} was given. A dirty lens "
            "scatters light, and is told as a larger number than it has."
        )
    beyond = verdict_of(check for psf, limit in found for check in beyond_diffraction(psf.quality, limit)).reason
    return f"{beyond[0].upper()}{beyond[1:]}: the f-number that was given is too large." if beyond else ""


def _words(told: Quantity) -> str:
    return f"{told.value:.1f} ± {np.hypot(told.uncertainty, PUPIL_SPREAD * told.value):.1f}"
