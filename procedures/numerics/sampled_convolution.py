"""Convolution of an image on the s grid, sampled at pixels: as a matrix, and applied."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics import loops
from procedures.numerics.arrays import Array32

np.empty(31 << 20, np.uint8)
# The C library (glibc) keeps twice as much freed memory as the largest freed block of up to 32 MiB: after this one, the
# pages of a matrix are not returned to the system and cleared again for every PSF.


def sample_convolution(
    raster: Array32,
    rows: npt.NDArray[np.int64],
    columns: npt.NDArray[np.int64],
    weight: Array32,
    s: int,
    k: int,
    more: int = 0,
) -> Array32:
    """The matrix S_s U: convolution with a raster, sampled at pixels, each row scaled by its weight.

    Parameters
    ----------
    raster : (s (rows - 1) + k, s (columns - 1) + k) float32 the image on the s grid, with a border of k // 2 samples
    rows, columns : (m,) int64 the pixels
    weight : (m,) float32 one over the standard deviation of the pixel's sample
    more : additional columns, filled by the caller

    Returns
    -------
    (m, k^2 + more) float32

    References
    ----------
    Delbracio, Muse, Almansa, IPOL 2012, section 4.7.
    """
    A = np.empty((len(rows), k * k + more), np.float32)  # NumPy allocates large pages
    loops.fill_convolution(A, raster, rows, columns, weight, s, k)
    return A
