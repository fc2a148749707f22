"""A PSF's profile: its mean over directions and the energy inside circles, from the centre to the end of its tail."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import tail_border, tail_kernels
from procedures.psf import Psf

Array = npt.NDArray[np.float64]

STEPS_PER_SAMPLE = 2
"""Circles per sample inside the support."""
FARTHER = 1.2
"""Outside it every circle is larger than the one before by this."""
DIRECTIONS = 32
FINE = 4
"""Points per sample between which the energy inside a circle is summed."""


@dataclass(frozen=True, eq=False)
class Profile:
    """A whole PSF's mean over directions about its centre, and the energy inside circles, with standard uncertainties.

    Attributes
    ----------
    radius : (n,) float64
        In pixels of the plane, from 0.
    density, density_uncertainty : (n,) float64
        Energy per square pixel on each circle, where all light is 1.
    energy, energy_uncertainty : (n,) float64
        Share of all light inside each circle.
    support : float
        Radius in pixels up to which circles lie inside the support; farther out the tail's shapes tell.
    """

    radius: Array
    density: Array
    density_uncertainty: Array
    energy: Array
    energy_uncertainty: Array
    support: float


def radial_profile(psf: Psf) -> Profile:
    """The profile out to the end of the tail's shapes; without a tail, to where circles touch the support's sides.

    It is that of the band-limited PSF between its samples, as the encircled energy of `procedures.quality`; on circles
    outside the support, of the tail's shapes as they are.
    """
    p, n = psf.parameters, psf.k**2
    radius, on, inside = _weights(psf.k, with_tail=len(p) > n)
    on, inside = on[:, : len(p)] * psf.s**2, inside[:, : len(p)]
    density, energy = on @ p / psf.light, inside @ p / psf.light
    return Profile(
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
    """Circles' radii in samples (n,), and what each parameter adds to the density per squared sample on them and to
    the energy inside them, (n, k^2 + q) each."""
    radius = np.arange(STEPS_PER_SAMPLE * (k // 2) + 1) / STEPS_PER_SAMPLE
    if not with_tail:
        offsets = np.arange(k) - k // 2
        on, inside = _on_circles(radius, offsets, k), _inside_circles(radius, offsets)
        return radius, on.reshape(len(radius), -1), inside.reshape(len(radius), -1)
    end = tail_border(k)
    steps = int(np.log(end / radius[-1]) / np.log(FARTHER))
    radius = np.concatenate([radius, end * FARTHER ** np.arange(-steps, 1.0)])
    offsets = np.arange(-end, end + 1)
    images = tail_kernels(k).reshape(-1, len(offsets) ** 2).T
    rows = slice(end - k // 2, end + k // 2 + 1)
    found = []
    for weights in (_on_circles(radius, offsets, k), _inside_circles(radius, offsets)):
        inside = weights[:, rows, rows].reshape(len(radius), -1)
        found.append(np.hstack([inside, weights.reshape(len(radius), -1) @ images]))
    found[0][:, k * k :] += _tail_on_circles(radius, k)
    return radius, found[0], found[1]


def _circles(radius: Array) -> tuple[Array, Array]:
    """Points (x, y) in DIRECTIONS on circles, (n, d) each."""
    turn = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    return radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)


def _within(x: Array, y: Array, k: int) -> npt.NDArray[np.bool_]:
    return np.asarray(np.maximum(np.abs(x), np.abs(y)) <= k / 2)


def _on_circles(radius: Array, offsets: npt.NDArray[np.intp], k: int) -> Array:
    """What samples at these offsets add to the mean on circles by the band-limited image inside the support:
    (n, size, size)."""
    found = np.zeros((len(radius), len(offsets), len(offsets)))
    reaching = radius <= k / 2**0.5  # the others lie outside
    x, y = _circles(radius[reaching])
    across, down = (np.sinc(at[..., None] - offsets) for at in (x, y))
    found[reaching] = (down * _within(x, y, k)[..., None]).transpose(0, 2, 1) @ across / DIRECTIONS
    return found


def _tail_on_circles(radius: Array, k: int) -> Array:
    """What unit amplitudes add to the mean on circles outside the support, (n, q): there the shapes are powers of r,
    those that turn with the direction times the mean one's."""
    (x, y), kernels, at = _circles(radius), tail_kernels(k), k // 2 + 1
    r, angle = np.maximum(np.hypot(x, y), 1.0), np.arctan2(y, x)
    mean, close = (
        shape[len(shape) // 2, len(shape) // 2 + at] * (at / r) ** power
        for shape, power in zip(kernels[:2], (3, 5), strict=True)
    )
    turning = [mean * wave(m * angle) for m in (2, 4) for wave in (np.cos, np.sin)]
    outside = ~_within(x, y, k)
    return np.stack([(shape * outside).mean(axis=1) for shape in (mean, close, *turning)], axis=1)


def _inside_circles(radius: Array, offsets: npt.NDArray[np.intp]) -> Array:
    """What samples at these offsets add to the energy of the band-limited image inside circles: (n, size, size).

    The energy is summed over squares FINE times smaller than the samples', which the circle enters linearly; by
    symmetry one quadrant is enough.
    """
    end = int(offsets[-1])
    t = np.arange(FINE * end + 1) / FINE
    M = np.sinc(t[:, None] - np.arange(end + 1)) + np.sinc(t[:, None] + np.arange(end + 1))
    M[0] /= 2  # an axis belongs to both sides
    distance = np.hypot(t, t[:, None])
    found = np.empty((len(radius), end + 1, end + 1))
    for i, r in enumerate(radius):
        reached = int(np.searchsorted(t, r + 1 / FINE))
        near = M[:reached]
        weight = np.clip((r - distance[:reached, :reached]) * FINE + 0.5, 0, 1) * (r > 0) / FINE**2
        found[i] = near.T @ (weight @ near)
    return found[:, np.abs(offsets)[:, None], np.abs(offsets)]
