"""The effect of a remedy: the chart photographed by a simulated camera like the measured one, before and after it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.choice import COMMON, combined
from procedures.numbers import MTF50_HORIZONTAL, PIXELS_PER_PATTERN
from procedures.outcome import BadInput, Quantity
from procedures.pattern import Chart
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.quality import PRINT_BLUR
from procedures.transfer_function import Otf
from simulators.camera.camera import SimulatedCamera, pixels_at, render_plane
from simulators.camera.optics import GaussianBlur, Optics, PixelAperture
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

GAUSSIAN_AT_HALF = 0.1874
"""sigma f of a Gaussian whose transfer function is 0.5 at f: sqrt(ln 2 / 2) / pi."""
PIXEL_SIGMA = 0.2887
"""Standard deviation of a pixel's aperture, pixels: sqrt(1 / 12)."""
PITCH_UM, WHITE = 7.5, 0.8
CHART = Chart.from_seed()
SEEDS = (1, 2)
SAME_WIDTH = 0.05
"""Relative difference of widths that changes nothing."""


@dataclass(frozen=True)
class TwinPrediction:
    """A change of the set-up, and the standard uncertainty of MTF50 after it, in the unit of the record."""

    words: str
    uncertainty: float


def predictions(plane: Mapping[str, Any]) -> list[TwinPrediction]:
    """The predicted effects of a better distance and of four times the light, from the record of a plane.

    The twin has the measured MTF50, noise and size of the chart; its remaining properties are those of an ideal lens.
    Terms that all photographs of the chart share stay as they are, except the blur of the print, which grows with the
    square of the chart's width.
    Raises BadInput if the record is not that of a photograph of the chart.
    """
    try:
        width, mtf50 = float(plane[PIXELS_PER_PATTERN]), float(plane[MTF50_HORIZONTAL]["value"])
        budget: Mapping[str, float] = plane[MTF50_HORIZONTAL]["budget"]
        noise, s, k = float(plane["diagnostics"]["noise"]), int(plane["s"]), int(plane["k"])
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput("the digital twin needs the record of a photograph of the chart", "name one") from error
    best = pixels_at(1.0, s)
    changes = {"four times the light": (width, noise / 2)}
    if abs(best / width - 1) > SAME_WIDTH:
        words = (
            f"{width / best:.2g} times the distance (s/t = 1, a chart {best:.0f} pixels wide instead of {width:.0f})"
        )
        changes |= {words: (best, noise)}
    parameters = PatternParameters(s, k, chosen=True)
    own = combined({term: one for term, one in budget.items() if term not in COMMON})
    now = _uncertainty(width, noise, mtf50, parameters)
    return [
        TwinPrediction(
            words, math.hypot(_shared(budget, wide / width), own * _uncertainty(wide, change, mtf50, parameters) / now)
        )
        for words, (wide, change) in changes.items()
    ]


def _shared(budget: Mapping[str, float], scale: float) -> float:
    """Uncertainty by what all photographs of the chart share, with a chart `scale` times as wide."""
    return combined(
        {term: one * (scale**2 if term == PRINT_BLUR else 1.0) for term, one in budget.items() if term in COMMON}
    )


def _uncertainty(width: float, noise: float, mtf50: float, parameters: PatternParameters) -> float:
    """Standard uncertainty of MTF50 of the twin without shared terms: median of several photographs.

    noise : standard deviation of white samples over the chart's contrast
    """
    sigma = max((GAUSSIAN_AT_HALF / mtf50) ** 2 - PIXEL_SIGMA**2, 0.01) ** 0.5
    electrons = (1 / max(noise, 1e-4)) ** 2
    size = round(1.8 * width) + 40
    sensor = Sensor(size, size, None, full_well_e=electrons / WHITE, gain_e_per_dn=electrons / WHITE / 15000)
    camera = SimulatedCamera(
        sensor=sensor, pitch_um=PITCH_UM, optics=Optics((GaussianBlur(sigma), PixelAperture()), PITCH_UM)
    )
    scene = Scene((camera.place(CHART, pixels=width, roll_deg=3.0),))
    uncertainties = []
    for seed in SEEDS:
        samples = render_plane(scene, camera, np.random.default_rng(seed), exposure_s=_exposure_s(camera))
        outcome = estimate_psf(samples, CHART, parameters)
        if outcome.value is not None:
            budget = outcome.value.quality.budgets[MTF50_HORIZONTAL]
            uncertainties.append(combined({term: one for term, one in budget.items() if term not in COMMON}))
    return float(np.median(uncertainties)) if uncertainties else float("inf")


def _exposure_s(camera: SimulatedCamera) -> float:
    return WHITE * camera.sensor.full_well_e / camera.white_e_per_s


# --- Comparison of an estimated PSF with the true one and with its stated uncertainty ---

Array = npt.NDArray[np.float64]

FINE_STEP = 0.001
"""Step of the curve from which the true MTF50 is read, cycles per pixel."""
DIRECTIONS = ("horizontal", "vertical")


@dataclass(frozen=True)
class ComparedNumber:
    """A measured number and its true value."""

    measured: Quantity
    true: float

    @property
    def sigmas(self) -> float:
        """Measured minus true, in standard uncertainties."""
        return (self.measured.value - self.true) / self.measured.uncertainty


@dataclass(frozen=True, eq=False)
class TruthComparison:
    """An estimate compared with the truth.

    otf : callable
        The true transfer function of the whole PSF at frequencies (fx, fy) in cycles per pixel of the plane.
    aligned : (k, k) float64
        The true PSF after the best subpixel shift.
    error : float
        Relative L2 distance from it.
    expected : float
        Expected error: root sum of squares of the covariance's and the truncation's.
    centre_px : (float, float)
        (x, y) from the chart's marks in the true image to the estimate's centre, in pixels of the plane.
    mtf50 : mapping of direction to ComparedNumber
    """

    otf: Otf
    aligned: Array
    error: float
    expected: float
    centre_px: tuple[float, float]
    mtf50: Mapping[str, ComparedNumber]

    @property
    def ratio(self) -> float:
        return self.error / self.expected

    @property
    def centre_error_px(self) -> float:
        """Error of the centre, in pixels of the plane."""
        return math.hypot(*self.centre_px)


def compare(estimate: PatternPsf, samples: Array, floor: float, otf: Otf) -> TruthComparison:
    """Compare an estimate with the PSF that blurred its photograph.

    estimate : PatternPsf
    samples : (k, k) float64
        The true PSF on the estimate's grid, of sum 1, its centre sample the geometric centre.
    floor : float
        Norm of the PSF outside the support, relative to that of the whole PSF.
    otf : callable
        The true transfer function of the whole PSF.
    """
    s = estimate.psf.s
    aligned, shift = align(samples, estimate.psf.h)
    # the estimate's origin is the image of the marks: a PSF that displaces them to the right is itself displaced left
    centre = shift / s + mark_offset(samples, s, estimate.registration.jacobian())
    return TruthComparison(
        otf=otf,
        aligned=aligned,
        error=float(np.linalg.norm(estimate.psf.h - aligned) / np.linalg.norm(samples)),
        expected=math.hypot(estimate.diagnostics["relative_uncertainty"], floor),
        centre_px=(float(centre[0]), float(centre[1])),
        mtf50=_mtf50(estimate, otf),
    )


def align(truth: Array, h: Array) -> tuple[Array, Array]:
    """The truth (k, k) after the subpixel shift that minimises its distance from h, and the shift (x, y) in samples.

    Gauss-Newton on a Fourier shift, with zeros beyond the support.
    """
    k = len(truth)
    spectrum = np.fft.fft2(np.pad(truth, k))
    wave = -2j * np.pi * np.fft.fftfreq(3 * k)
    shift = np.zeros(2)

    def cut(filtered: npt.NDArray[np.complex128]) -> Array:
        return np.asarray(np.fft.ifft2(filtered).real[k:-k, k:-k], dtype=np.float64)

    for _ in range(10):
        moved = spectrum * np.exp(wave * shift[0]) * np.exp(wave * shift[1])[:, None]
        slopes = np.stack([cut(moved * wave).ravel(), cut(moved * wave[:, None]).ravel()], axis=1)
        step = np.linalg.lstsq(slopes, (h - cut(moved)).ravel(), rcond=None)[0]
        shift = shift + step
        if np.abs(step).max() < 1e-7:
            break
    return cut(moved), shift


def _mtf50(estimate: PatternPsf, otf: Otf) -> dict[str, ComparedNumber]:
    """Measured and true MTF50, in the directions in which both exist."""
    f = np.arange(0.0, estimate.psf.s / 2, FINE_STEP)
    pairs = {}
    for name, (x, y) in zip(DIRECTIONS, ((f, 0 * f), (0 * f, f)), strict=True):
        measured = estimate.quality.numbers.get(f"mtf50_{name}")
        below = np.flatnonzero(np.abs(otf(x, y)) < 0.5)
        if measured is not None and len(below):
            pairs[name] = ComparedNumber(measured, float(f[below[0]]) - FINE_STEP / 2)
    return pairs
