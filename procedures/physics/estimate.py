"""Physical model of a measured PSF: sensor and lens parameters with uncertainties, wavefront error, Strehl ratio."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.display import summary
from procedures.numbers import STREHL_LENS, WAVEFRONT_RMS, WAVEFRONT_RMS_NM
from procedures.outcome import BadParameter, Check, Outcome, Quantity, Verdict, checked_type, verdict_of
from procedures.physics.choice import choose, scale_of
from procedures.physics.fit import ModelFit, WhitenedPsf
from procedures.physics.model import Grid, names_of
from procedures.physics.one_sided import OneSided, at_bounds
from procedures.physics.pupil import TERMS
from procedures.physics.sensor import Aperture
from procedures.psf import Psf
from procedures.quality import Diffraction

Array = npt.NDArray[np.float64]

METHOD = "generalised least squares by the PSF's covariance"
STEP = 1e-4
ALIKE = 2.0
"""Difference of the criterion up to which two models are equally good: odds of e to 1."""
SENSOR_UNITS = {"side": "pixel", "separation": "pixel", "diffusion": "pixel", "notch": "1"}
EVEN = ("defocus", "astigmatism", "astigmatism_oblique", "spherical")
"""Aberrations whose common sign one PSF does not determine: the largest is taken as positive."""


@dataclass(frozen=True)
class Physics:
    """The physical model of a PSF.

    Attributes
    ----------
    aperture, low_pass : str
        The photosite's shape and the low-pass filter.
    missing_corner_deg : int or None
        Direction of the missing corner of an L-shaped aperture, from x towards y, y down.
    numbers : mapping of str to Quantity
        side, notch, separation, diffusion (in sensor pixels), fill_factor; aberrations; wavefront_rms, also in
        nanometres; strehl_lens, the Strehl ratio of the lens alone. A parameter at its bound has the bound as its
        value, and a one-sided uncertainty.
    chi_square, freedom : float, int
    remaining : float
        Chi-square over that of the zero model: the fraction of the PSF, weighted by its noise, left unexplained.
    prediction : (k, k) float64
        The model's PSF.
    candidates : tuple of (str, float)
        The models tried, and the excess of their criterion over the best one's.
    """

    aperture: str
    low_pass: str
    missing_corner_deg: int | None
    numbers: Mapping[str, Quantity]
    chi_square: float
    freedom: int
    remaining: float
    prediction: Array
    candidates: tuple[tuple[str, float], ...]

    __repr__ = summary


def estimate_physics(
    psf: Psf, diffraction: Diffraction | None, pitch: int, progress: Callable[[str], object] | None = None
) -> Outcome[Physics]:
    """Fit the physical model that explains a measured PSF best.

    Parameters
    ----------
    psf : Psf
        With its full covariance.
    diffraction : Diffraction or None
        Aperture, pitch of the plane's pixels, wavelength.
    pitch : int
        Sensor pixels per pixel of the plane.
    progress : callable, optional
        Called with a sentence after every model that was fitted.

    Raises
    ------
    BadParameter
        If aperture or pitch are not known: without them diffraction and defocus cannot be separated.
    """
    checked_type(psf, Psf, "pass the psf of an estimate, outcome.result().psf, or field.at(x, y)")
    data = WhitenedPsf.of(Grid(psf, check_known(diffraction), pitch))
    fit, tried = choose(data, progress)
    numbers = _numbers(data, fit)
    bounded = at_bounds(data, fit, numbers)
    numbers |= {bound.name: bound.quantity(numbers[bound.name]) for bound in bounded}
    return verdict_of(_doubts(fit, tried, bounded), _physics(data, fit, tried, numbers))


def check_known(diffraction: Diffraction | None) -> Diffraction:
    """The diffraction limit. Raises BadParameter where it is not known."""
    if diffraction is None:
        raise BadParameter(
            "the physics of a PSF needs the sensor's pitch and the f-number; one of them is not known",
            "give --pixel-pitch-um and --f-number",
        )
    return diffraction


def _doubts(fit: ModelFit, tried: list[ModelFit], bounded: list[OneSided]) -> list[Check]:
    ratio = fit.chi2 / fit.freedom
    scale = scale_of(tried)
    limit = fit.criterion(scale) + ALIKE
    rivals = [other for other in tried if other.parts != fit.parts and other.criterion(scale) < limit]
    return [
        Check("residual", ratio**0.5, 2**0.5, Verdict.DOUBTFUL,
              f"the residual of the best model is {ratio:.1f} times the expected noise variance",
              "check --f-number, --pixel-pitch-um and --wavelength-nm; the model contains no other causes of blur"),
        Check("rivals", bool(rivals), 0, Verdict.DOUBTFUL,
              f"this PSF does not separate two models: {_words(fit)}; {_words(rivals[0]) if rivals else ''}",
              "compare with other planes and apertures: aberrations change with them, the sensor's parts do not"),
        *(Check(one.name, not one.follows, 0, Verdict.DOUBTFUL, one.words,
                "take it as a limit, not as a value; reduce the noise, and check f-number and pixel pitch")
          for one in bounded),
    ]  # fmt: skip


def _physics(data: WhitenedPsf, fit: ModelFit, tried: list[ModelFit], numbers: Mapping[str, Quantity]) -> Physics:
    scale = scale_of(tried)
    least = fit.criterion(scale)
    prediction, _ = data.grid.model(fit.parts, fit.p)
    nothing = float(np.sum((data.W @ data.grid.psf.h.ravel()) ** 2))
    k = data.grid.psf.k
    return Physics(
        aperture=str(fit.parts.aperture),
        low_pass=str(fit.parts.low_pass),
        missing_corner_deg=fit.parts.aperture.missing_corner_deg,
        numbers=numbers,
        chi_square=fit.chi2,
        freedom=fit.freedom,
        remaining=fit.chi2 / nothing,
        prediction=prediction.reshape(k, k),
        candidates=tuple((_words(one), one.criterion(scale) - least) for one in tried),
    )


def _words(fit: ModelFit) -> str:
    free = [TERMS[i].replace("_", " ") for i in fit.parts.aberrations]
    lens = "all aberrations" if len(free) == len(TERMS) else " and ".join(free) or "no aberrations"
    charge = ", diffusion" if fit.parts.diffusion else ""
    return f"{fit.parts.aperture}, low-pass filter: {fit.parts.low_pass}{charge}, {lens}"


def _numbers(data: WhitenedPsf, fit: ModelFit) -> dict[str, Quantity]:
    names, n = names_of(fit.parts), data.rank
    even = [value for name, value in zip(names, fit.p, strict=True) if name in EVEN]
    sign = -1.0 if even and max(even, key=abs) < 0 else 1.0
    spread = np.sqrt(np.maximum(np.diag(fit.covariance), 0))
    numbers: dict[str, Quantity] = {}
    for name, value, uncertainty in zip(names, fit.p, spread, strict=True):
        if name in ("shift_x", "shift_y"):  # the centre is a convention of the marks
            continue
        unit = "wave rms" if name in TERMS else SENSOR_UNITS[name]
        signed = sign * value if name in EVEN else value
        numbers[name] = Quantity(float(signed), unit, float(uncertainty), METHOD, n)

    def derived(name: str, unit: str, function: Callable[[Array], float]) -> None:
        gradient = np.array(
            [(function(fit.p + e) - function(fit.p - e)) / (2 * STEP) for e in STEP * np.eye(len(fit.p))]
        )
        variance = float(gradient @ fit.covariance @ gradient)
        numbers[name] = Quantity(function(fit.p), unit, max(variance, 0.0) ** 0.5, METHOD, n)

    place = {name: i for i, name in enumerate(names)}
    notch = place.get("notch") if fit.parts.aperture is not Aperture.SQUARE else None
    derived("fill_factor", "1", lambda p: float(p[place["side"]] ** 2 * (1 - (p[notch] ** 2 if notch else 0.0))))
    count, pupil = 2 + len(fit.parts.names), data.grid.pupil
    derived(WAVEFRONT_RMS, "wave", lambda p: float(np.linalg.norm(p[count:])))
    nm = data.grid.diffraction.wavelength_nm
    derived(WAVEFRONT_RMS_NM, "nm", lambda p: nm * float(np.linalg.norm(p[count:])))

    def strehl(p: Array) -> float:
        waves = np.zeros(len(TERMS))
        waves[list(fit.parts.aberrations)] = p[count:]
        return pupil.strehl(waves)

    derived(STREHL_LENS, "1", strehl)
    return numbers
