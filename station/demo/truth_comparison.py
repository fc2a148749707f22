"""How near an estimated PSF comes to a known one, beside what its error bars promise."""

from __future__ import annotations

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
"""Step, in cycles per pixel, of the curve on which the truth's MTF50 is read."""
DIRECTIONS = ("horizontal", "vertical")


@dataclass(frozen=True)
class Against:
    """A measured number against the true one."""

    measured: Quantity
    true: float

    @property
    def sigmas(self) -> float:
        """Measured less true, in standard uncertainties."""
        return (self.measured.value - self.true) / self.measured.uncertainty


@dataclass(frozen=True, eq=False)
class TruthComparison:
    """An estimate beside the truth.

    Attributes
    ----------
    otf : callable
        The true transfer function, of all light, at frequencies (fx, fy) in cycles per pixel of the plane.
    aligned : (k, k) float64
        The truth after the subpixel shift that brings it nearest.
    error : float
        Relative L2 distance from that.
    expected : float
        What error the estimate's covariance and the support's truncation give: root of the sum of their squares.
    centre_px : (float, float)
        (x, y) from where the truth shows the chart's marks to the estimate's centre, in pixels of the plane.
    mtf50 : mapping of direction to Against
    """

    otf: Otf
    aligned: Array
    error: float
    expected: float
    centre_px: tuple[float, float]
    mtf50: Mapping[str, Against]

    @property
    def ratio(self) -> float:
        """Error over what was expected: near 1 when the error bars are true."""
        return self.error / self.expected

    @property
    def centre_error_px(self) -> float:
        """Distance of the centre from where it should be, in pixels of the plane."""
        return math.hypot(*self.centre_px)


def compare(found: PatternPsf, samples: Array, floor: float, otf: Otf) -> TruthComparison:
    """An estimate against the PSF that made its photograph.

    Parameters
    ----------
    found : PatternPsf
    samples : (k, k) float64
        The true PSF on the estimate's grid, of sum 1, its centre sample the geometric centre.
    floor : float
        Norm of what lies outside the support, relative to that of the whole PSF.
    otf : callable
        The true transfer function of the whole PSF.
    """
    s = found.psf.s
    aligned, shift = align(samples, found.psf.h)
    # the estimate's origin lies where the marks are seen, so a PSF that shows them further right is drawn further left
    centre = shift / s + mark_offset(samples, s, found.registration.jacobian())
    return TruthComparison(
        otf=otf,
        aligned=aligned,
        error=float(np.linalg.norm(found.psf.h - aligned) / np.linalg.norm(samples)),
        expected=math.hypot(found.diagnostics["relative_uncertainty"], floor),
        centre_px=(float(centre[0]), float(centre[1])),
        mtf50=_mtf50(found, otf),
    )


def align(truth: Array, h: Array) -> tuple[Array, Array]:
    """The truth (k, k) shifted to where it is nearest to h, and that shift (x, y) in samples.

    It is shifted in the Fourier domain, zero beyond its support, by Gauss-Newton steps.
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


def _mtf50(found: PatternPsf, otf: Otf) -> dict[str, Against]:
    """MTF50 of both, in the directions where both have one."""
    f = np.arange(0.0, found.psf.s / 2, FINE_STEP)
    pairs = {}
    for name, (x, y) in zip(DIRECTIONS, ((f, 0 * f), (0 * f, f)), strict=True):
        measured = found.quality.numbers.get(f"mtf50_{name}")
        below = np.flatnonzero(np.abs(otf(x, y)) < 0.5)
        if measured is not None and len(below):
            pairs[name] = Against(measured, float(f[below[0]]) - FINE_STEP / 2)
    return pairs
