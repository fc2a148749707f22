"""Comparison of an estimated PSF with the true one and with its stated uncertainty."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import Quantity
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.estimate import PatternPsf
from procedures.transfer_function import Otf

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

    otf : the true transfer function of the whole PSF at frequencies (fx, fy) in cycles per pixel of the plane
    aligned : (k, k) float64
        The true PSF after the best subpixel shift.
    error : relative L2 distance from it
    expected : expected error: root sum of squares of the covariance's and the truncation's
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
    floor : norm of the PSF outside the support, relative to that of the whole PSF
    otf : the true transfer function of the whole PSF
    """
    s = estimate.psf.s
    aligned, shift = align(samples, estimate.psf.h)
    # the estimate's origin is the image of the marks: a PSF that displaces them to the right is itself displaced left
    centre = shift / s + mark_offset(samples, s, estimate.registration.jacobian())
    f = np.arange(0.0, estimate.psf.s / 2, FINE_STEP)
    pairs = {}
    for name, (x, y) in zip(DIRECTIONS, ((f, 0 * f), (0 * f, f)), strict=True):
        measured = estimate.quality.numbers.get(f"mtf50_{name}")
        below = np.flatnonzero(np.abs(otf(x, y)) < 0.5)
        if measured is not None and len(below):
            pairs[name] = ComparedNumber(measured, float(f[below[0]]) - FINE_STEP / 2)
    return TruthComparison(
        otf=otf,
        aligned=aligned,
        error=float(np.linalg.norm(estimate.psf.h - aligned) / np.linalg.norm(samples)),
        expected=math.hypot(estimate.diagnostics["relative_uncertainty"], floor),
        centre_px=(float(centre[0]), float(centre[1])),
        mtf50=pairs,
    )


def align(truth: Array, h: Array) -> tuple[Array, Array]:
    """The truth (k, k) after the subpixel shift that minimises its distance from h, and the shift (x, y) in samples.
    Gauss-Newton on a Fourier shift, with zeros beyond the support."""
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
