"""The constant k of sigma = k r: Gaussian blur over the radius of the blur circle (4.18), by measured PSFs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter, Quantity
from procedures.psf import Psf

SMALLEST_PX = 1.0
"""Radius of the blur circle below which sigma is not proportional to it: diffraction and pixels blur as much."""


@dataclass(frozen=True, eq=False)
class GaussianConstant:
    """k, the sigmas (n,) in pixels of the Gaussians nearest to the PSFs, and their greatest relative distance from
    k r."""

    k: Quantity
    sigmas_px: Array
    departure: float


def gaussian_constant(psfs: Sequence[Psf], radii_px: npt.ArrayLike) -> GaussianConstant:
    """k of a lens by PSFs measured at known radii of the blur circle, as `CameraSetting.blur_radius_px` gives them.

    Raises BadParameter unless each PSF has a radius, and two or more differ and are a pixel or more.
    """
    r = np.abs(np.asarray(radii_px, np.float64))
    if len(psfs) != len(r) or len(np.unique(r.round(3))) < 2 or not SMALLEST_PX <= r.min() < np.inf:
        raise BadParameter(
            f"k needs two PSFs of different blur, each with a radius of {SMALLEST_PX:g} pixel or more; got "
            f"{len(psfs)} with the radii {', '.join(f'{one:.2f}' for one in r)}",
            "photograph the chart farther out of focus",
        )
    sigmas = np.array([gaussian_sigma_px(psf) for psf in psfs])
    k = float(sigmas @ r / (r @ r))
    residual = sigmas - k * r
    spread = float(np.sqrt(residual @ residual / (len(r) - 1) / (r @ r)))
    number = Quantity(k, "1", spread, "least squares of sigma = k r, Gaussians nearest to the PSFs", len(r))
    return GaussianConstant(number, sigmas, float(np.max(np.abs(residual) / (k * r))))


def gaussian_sigma_px(psf: Psf) -> float:
    """Sigma in pixels of the round Gaussian nearest to the PSF, by least squares over size, place and height."""
    x = (np.arange(psf.k) - psf.k // 2) / psf.s

    def residual(given: Array) -> Array:
        sigma, across, down, height = given
        rows, columns = (np.exp(-(((x - at) / sigma) ** 2) / 2) for at in (down, across))
        return np.asarray(height * np.outer(rows, columns) - psf.h).ravel()

    light = np.abs(psf.h).sum(axis=0)
    return float(abs(least_squares(residual, (np.sqrt(light @ x**2 / light.sum()), 0.0, 0.0, psf.h.max())).x[0]))
