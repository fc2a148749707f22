"""Fourier transforms by NumPy and OpenCV, and fast lengths.

SciPy's transforms take as long to import as estimating a PSF; NumPy's take six times as long as OpenCV's for a large
picture in single precision.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numpy.fft import fftfreq, ifft, irfft2

from procedures.numerics import loops
from procedures.numerics.arrays import Array, Array32, Indices

__all__ = ["fft2", "fftfreq", "ifft", "irfft2", "irfft_rows", "next_fast_len", "rfft2"]


def fft2(picture: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.complexfloating]:
    """The transform of a real picture (rows, columns)."""
    if picture.dtype == np.float32:
        real = np.ascontiguousarray(picture)
        return np.asarray(cv2.dft(real, flags=cv2.DFT_COMPLEX_OUTPUT)).view(np.complex64)[..., 0]
    return np.asarray(np.fft.fft2(picture))


def rfft2(picture: npt.NDArray[np.floating], shape: Sequence[int] | None = None) -> npt.NDArray[np.complexfloating]:
    """The half-plane transform of a real picture (rows, columns), or of pictures along their last two axes.

    shape : (rows, columns) shape after zero padding.
    """
    if picture.dtype != np.float32 or picture.ndim != 2:
        return np.asarray(np.fft.rfft2(picture, shape))
    rows, columns = tuple(shape) if shape is not None else picture.shape
    if (rows, columns) != picture.shape:
        filled = np.zeros((rows, columns), dtype=np.float32)
        filled[: picture.shape[0], : picture.shape[1]] = picture[:rows, :columns]
        picture = filled
    # the half plane (rows, columns // 2 + 1) of a real picture's transform from OpenCV's packed form: real and
    # imaginary parts side by side, and one below the other in the columns whose rows are transforms of real numbers
    packed = np.asarray(cv2.dft(np.ascontiguousarray(picture)))
    rows, columns = packed.shape
    half = np.empty((rows, columns // 2 + 1), dtype=np.complex64)
    half.view(np.float32)[:, 2 : columns + columns % 2] = packed[:, 1 : columns - 1 + columns % 2]
    for last in {0, columns - 1} if columns % 2 == 0 else {0}:
        packed_column, into = packed[:, last], half[:, (last + 1) // 2]
        middle = (rows + 1) // 2
        into[0] = packed_column[0]
        into[1:middle] = packed_column[1 : 2 * middle - 1 : 2] + 1j * packed_column[2 : 2 * middle - 1 : 2]
        into[rows - middle + 1 :] = into[1:middle][::-1].conj()
        if rows % 2 == 0:
            into[middle] = packed_column[-1]
    return half


def irfft_rows(spectra: npt.NDArray[np.complexfloating], columns: int) -> Array32:
    """Real rows (rows, columns) whose half transforms are `spectra`, zero beyond them."""
    packed = np.zeros((len(spectra), columns), dtype=np.float32)  # alternating real and imaginary parts after the first
    parts = np.ascontiguousarray(spectra, dtype=np.complex64).view(np.float32)[:, : columns + 1]
    packed[:, 0], packed[:, 1 : parts.shape[1] - 1] = parts[:, 0], parts[:, 2:]
    flags = cv2.DFT_INVERSE | cv2.DFT_ROWS | cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT
    return np.asarray(cv2.dft(packed, flags=flags), dtype=np.float32)


@lru_cache(maxsize=256)
def next_fast_len(n: int) -> int:
    """The smallest length of at least n that is a product of twos, threes and fives."""
    best = 1 << max(n - 1, 0).bit_length()
    five = 1
    while five < best:
        three = five
        while three < best:
            best = min(best, three << max(-(-n // three) - 1, 0).bit_length())
            three *= 3
        five *= 5
    return best


# --- Bessel's functions J0 and J1 and the integral of J0, by Bessel's integrals: SciPy's take longer to import ---
# J_n(x) is the mean over theta of cos(n theta - x sin theta) (NIST DLMF 10.9.2), and the integral of J0 that of sin(x
# sin theta) / sin theta. Only the part even about both axes of theta contributes, so a quarter turn suffices. Over
# whole periods the trapezoidal rule with N points has an error of J_N(x), which vanishes from N = 2 x + 80 on
# (Trefethen and Weideman, SIAM Review 56, 2014).

MORE_POINTS = 40
LARGEST_BLOCK = 1 << 20  # values of the integrand per block


def j0(x: npt.ArrayLike) -> Array:
    """J0 at real x, to 1e-14."""
    return _mean(x, lambda x, sine: np.cos(x * sine))


def j1(x: npt.ArrayLike) -> Array:
    """J1 at real x, to 1e-14."""
    return _mean(x, lambda x, sine: np.sin(x * sine) * sine)


def integral_of_j0(x: npt.ArrayLike) -> Array:
    """The integral of J0 from 0 to real x, to 1e-14 of x."""
    return _mean(x, lambda x, sine: np.sin(x * sine) / sine)


def _mean(x: npt.ArrayLike, integrand: Callable[[Array, Array], Array]) -> Array:
    """Mean over theta of an integrand of x and sin theta, at points that avoid its removable poles."""
    values = np.asarray(x, dtype=np.float64)
    flat = values.ravel()
    points = (int(np.abs(flat).max(initial=0.0)) + MORE_POINTS) // 2 + 1
    sine = np.sin(np.pi / 2 * (np.arange(points) + 0.5) / points)
    rows = max(LARGEST_BLOCK // points, 1)
    out = np.empty(len(flat))
    for first in range(0, len(flat), rows):
        part = slice(first, first + rows)
        out[part] = integrand(flat[part, None], sine).mean(axis=1)
    return out.reshape(values.shape)


# --- Convolution of an image on the s grid, sampled at pixels: as a matrix, and applied ---

np.empty(31 << 20, np.uint8)
# The C library (glibc) keeps twice as much freed memory as the largest freed block of up to 32 MiB: after this one, the
# pages of a matrix are not returned to the system and cleared again for every PSF.


def sample_convolution(
    raster: Array32, rows: Indices, columns: Indices, weight: Array32, s: int, k: int,
    more: int = 0,
) -> Array32:  # fmt: skip
    """The matrix S_s U: convolution with a raster, sampled at pixels, each row scaled by its weight.

    raster : (s (rows - 1) + k, s (columns - 1) + k) float32 the image on the s grid, with a border of k // 2 samples
    rows, columns : (m,) int64 the pixels
    weight : (m,) float32 one over the standard deviation of the pixel's sample
    more : additional columns, filled by the caller

    Returns
    -------
    (m, k^2 + more) float32

    Source: Delbracio, Muse, Almansa, IPOL 2012, section 4.7.
    """
    A = np.empty((len(rows), k * k + more), np.float32)  # NumPy allocates large pages
    loops.fill_convolution(A, raster, rows, columns, weight, s, k)
    return A
