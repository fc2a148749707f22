"""Radial profile of a PSF: mean over directions, and encircled energy, from the centre to the end of the tail."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array
from procedures.numerics.kernel_tail import tail_border, tail_kernels
from procedures.psf import Psf

STEPS_PER_SAMPLE = 2
"""Circles per sample inside the support."""
RADIUS_RATIO = 1.2
"""Ratio of successive radii outside the support."""
DIRECTIONS = 32
OVERSAMPLING = 4
"""Points per sample of the sum inside a circle."""


@dataclass(frozen=True, eq=False)
class RadialProfile:
    """Mean of a PSF over directions about its centre, and encircled energy, with standard uncertainties.

    radius : (n,) in pixels of the plane, from 0
    density, density_uncertainty : (n,) energy per square pixel on each circle, for total energy 1
    energy, energy_uncertainty : (n,) share of the total energy inside each circle
    support : radius in pixels of the largest circle inside the support; beyond it the profile is that of the tail's
        shapes
    """

    radius: Array
    density: Array
    density_uncertainty: Array
    energy: Array
    energy_uncertainty: Array
    support: float


def radial_profile(psf: Psf) -> RadialProfile:
    """Compute the profile to the end of the tail's shapes; without a tail, to the largest circle inside the support.

    It is that of the band-limited PSF between its samples, as the encircled energy of `procedures.quality`; outside the
    support it is that of the tail's shapes.
    """
    p, n = psf.parameters, psf.k**2
    radius, on, inside = _weights(psf.k, with_tail=len(p) > n)
    on, inside = on[:, : len(p)] * psf.s**2, inside[:, : len(p)]
    density, energy = on @ p / psf.light, inside @ p / psf.light
    return RadialProfile(
        radius / psf.s,
        density,
        _sigma(psf, (on - density[:, None] * psf.weights) / psf.light),
        energy,
        _sigma(psf, (inside - energy[:, None] * psf.weights) / psf.light),
        psf.k // 2 / psf.s,
    )


def _sigma(psf: Psf, slope: Array) -> Array:
    variance = np.einsum("ij,ij->i", slope @ psf.parameter_covariance, slope)
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


@lru_cache(maxsize=8)
def _weights(k: int, *, with_tail: bool) -> tuple[Array, Array, Array]:
    """Radii in samples (n,), and the contributions of each parameter to the density per squared sample on the circles
    and to the energy inside them, (n, k^2 + q) each."""
    radius = np.arange(STEPS_PER_SAMPLE * (k // 2) + 1) / STEPS_PER_SAMPLE
    if not with_tail:
        offsets = np.arange(k) - k // 2
        on, inside = _on_circles(radius, offsets, k), _inside_circles(radius, offsets)
        return radius, on.reshape(len(radius), -1), inside.reshape(len(radius), -1)
    end = tail_border(k)
    steps = int(np.log(end / radius[-1]) / np.log(RADIUS_RATIO))
    radius = np.concatenate([radius, end * RADIUS_RATIO ** np.arange(-steps, 1.0)])
    offsets = np.arange(-end, end + 1)
    images = tail_kernels(k).reshape(-1, len(offsets) ** 2).T
    rows = slice(end - k // 2, end + k // 2 + 1)
    contributions = []
    for weights in (_on_circles(radius, offsets, k), _inside_circles(radius, offsets)):
        inside = weights[:, rows, rows].reshape(len(radius), -1)
        contributions.append(np.hstack([inside, weights.reshape(len(radius), -1) @ images]))
    contributions[0][:, k * k :] += _tail_on_circles(radius, k)
    return radius, contributions[0], contributions[1]


def _circles(radius: Array) -> tuple[Array, Array]:
    """Points (x, y) in DIRECTIONS on circles, (n, d) each."""
    turn = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    return radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)


def _within(x: Array, y: Array, k: int) -> npt.NDArray[np.bool_]:
    return np.asarray(np.maximum(np.abs(x), np.abs(y)) <= k / 2)


def _on_circles(radius: Array, offsets: npt.NDArray[np.intp], k: int) -> Array:
    """Contributions (n, size, size) of samples at these offsets to the mean of the band-limited image on circles inside
    the support."""
    contributions = np.zeros((len(radius), len(offsets), len(offsets)))
    reaching = radius <= k / 2**0.5  # larger circles lie outside
    x, y = _circles(radius[reaching])
    across, down = (np.sinc(at[..., None] - offsets) for at in (x, y))
    contributions[reaching] = (down * _within(x, y, k)[..., None]).transpose(0, 2, 1) @ across / DIRECTIONS
    return contributions


def _tail_on_circles(radius: Array, k: int) -> Array:
    """Contributions (n, q) of unit amplitudes to the mean on circles outside the support, where the shapes are powers
    of r, the anisotropic ones times cosines and sines of the direction."""
    (x, y), kernels, at = _circles(radius), tail_kernels(k), k // 2 + 1
    r, angle = np.maximum(np.hypot(x, y), 1.0), np.arctan2(y, x)
    mean, close = (
        shape[len(shape) // 2, len(shape) // 2 + at] * (at / r) ** power
        for shape, power in zip(kernels[:2], (3, 5), strict=True)
    )
    anisotropic = [mean * wave(m * angle) for m in (2, 4) for wave in (np.cos, np.sin)]
    outside = ~_within(x, y, k)
    return np.stack([(shape * outside).mean(axis=1) for shape in (mean, close, *anisotropic)], axis=1)


def _inside_circles(radius: Array, offsets: npt.NDArray[np.intp]) -> Array:
    """Contributions (n, size, size) of samples at these offsets to the energy of the band-limited image inside circles.

    The energy is summed over squares FINE times smaller than the samples, weighted by a linear ramp at the circle; by
    symmetry one quadrant suffices.
    """
    end = int(offsets[-1])
    t = np.arange(OVERSAMPLING * end + 1) / OVERSAMPLING
    M = np.sinc(t[:, None] - np.arange(end + 1)) + np.sinc(t[:, None] + np.arange(end + 1))
    M[0] /= 2  # an axis belongs to both sides
    distance = np.hypot(t, t[:, None])
    contributions = np.empty((len(radius), end + 1, end + 1))
    for i, r in enumerate(radius):
        reached = int(np.searchsorted(t, r + 1 / OVERSAMPLING))
        near = M[:reached]
        weight = np.clip((r - distance[:reached, :reached]) * OVERSAMPLING + 0.5, 0, 1) * (r > 0) / OVERSAMPLING**2
        contributions[i] = near.T @ (weight @ near)
    return contributions[:, np.abs(offsets)[:, None], np.abs(offsets)]
