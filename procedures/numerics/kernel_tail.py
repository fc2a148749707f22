"""What the support cuts off: the far tail of the PSF, one number beside the k x k samples.

Diffraction's tail falls as 1/r^3 and carries some per cent of the energy beyond any support. Left out, it is not
noise: it is the scene blurred widely, which the outer samples of the support would take for their own. One kernel of
that shape, outside the support, with its amplitude free, keeps it out of them and tells how much was cut.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numerics import transforms
from procedures.numerics.bessel import integral_of_j0, j0, j1

Array = npt.NDArray[np.float64]

REACH = 4
"""The tail ends at so many half-widths of the support; what lies beyond is flat over any region of interest."""


def tail_border(k: int) -> int:
    """Samples of the s grid that the tail needs around a raster."""
    return REACH * (k // 2)


@lru_cache(maxsize=8)
def tail_kernel(k: int) -> Array:
    """1/r^3 outside the central k x k samples, within a circle, of sum 1: (K, K), K odd."""
    half = tail_border(k)
    x = np.arange(-half, half + 1)
    r = np.hypot(x, x[:, None])
    support = np.maximum(np.abs(x), np.abs(x[:, None])) <= k // 2
    kernel = np.where(support | (r > half), 0.0, 1 / np.maximum(r, 1) ** 3)
    kernel /= kernel.sum()
    kernel.flags.writeable = False  # shared by all callers
    return kernel


def tail_column(
    u: npt.NDArray[np.float32], rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], s: int, k: int
) -> Array:
    """An image seen through the tail, at pixels (m,): its amplitude is the energy outside over that inside.

    `u` is the image on the s grid with a border of `tail_border`.
    """
    # only every s-th sample is wanted: along y by folding the spectrum, which is exact
    shape = (s * transforms.next_fast_len(-(-u.shape[0] // s)), transforms.next_fast_len(u.shape[1]))
    product = transforms.rfft2(u, shape)
    product *= _spectrum(k, *shape)
    folded = product.reshape(s, shape[0] // s, -1).sum(axis=0)
    seen = transforms.irfft2(folded, (shape[0] // s, shape[1]))
    return np.asarray(seen[rows, s * columns] / s, dtype=np.float64)


@lru_cache(maxsize=8)
def _spectrum(k: int, rows: int, columns: int) -> npt.NDArray[np.complex64]:
    """Spectrum of the tail on a grid, shifted so that the first sample that all of it reaches comes first."""
    kernel = tail_kernel(k)
    placed = np.zeros((rows, columns), dtype=np.float32)
    placed[: len(kernel), : len(kernel)] = kernel
    first = len(kernel) - 1
    return np.asarray(transforms.rfft2(np.roll(placed, (-first, -first), axis=(0, 1))))


def tail_sum(k: int) -> float:
    """Energy of the whole 1/r^3 tail, without an end, over that within the reach."""
    return 1 + _beyond(k)


def tail_density(k: int) -> float:
    """c of the tail c / r^3 per sample of the s grid, whose sum within the reach is 1; r in samples."""
    half = tail_border(k)
    return float(tail_kernel(k)[half, 0] * half**3)


def tail_spectrum(fx: Array, fy: Array, k: int) -> Array:
    """Spectrum of the whole tail, without an end, at frequencies (n,) in cycles per sample; `tail_sum` at 0.

    Within the reach the kernel's own, real because it is even along both axes, from one quadrant. Beyond the radius R
    the Hankel transform of 1/r^3: over its value at 0 it is g(x) = x times the integral of J0(t) / t^2 from
    x = 2 pi f R on, which is J0(x) + x (the integral of J0 from 0 to x - 1 - J1(x)).
    """
    quadrant = tail_kernel(k)[tail_border(k) :, tail_border(k) :]
    n = np.arange(len(quadrant))
    times = np.where(n > 0, 2.0, 1.0)  # how often a column of the quadrant stands in the whole
    across, down = np.cos(2 * np.pi * fx[:, None] * n), np.cos(2 * np.pi * fy[:, None] * n)
    within = np.sum((down @ (quadrant * np.outer(times, times))) * across, axis=1)
    x = 2 * np.pi * np.hypot(fx, fy) * tail_border(k)
    return np.asarray(within + _beyond(k) * (j0(x) + x * (integral_of_j0(x) - 1 - j1(x))))


def _beyond(k: int) -> float:
    """Energy of 1/r^3 beyond the reach over that within: 2 pi / R over the sum."""
    half = tail_border(k)
    return 2 * np.pi / half * tail_density(k)
