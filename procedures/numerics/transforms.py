"""Fourier transforms by NumPy and OpenCV, and fast lengths.

SciPy's transforms take as long to import as estimating a PSF; NumPy's take six times as long as OpenCV's for a large
picture in single precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numpy.fft import fftfreq, ifft, irfft2

__all__ = ["fft2", "fftfreq", "ifft", "irfft2", "irfft_rows", "next_fast_len", "rfft2"]


def fft2(picture: npt.NDArray[np.inexact[Any]]) -> npt.NDArray[np.complexfloating]:
    """The transform of a picture (rows, columns), real or complex."""
    if picture.dtype == np.float32:
        real = np.ascontiguousarray(picture)
        return np.asarray(cv2.dft(real, flags=cv2.DFT_COMPLEX_OUTPUT)).view(np.complex64)[..., 0]
    if picture.dtype == np.complex64:
        pairs = np.ascontiguousarray(picture).view(np.float32).reshape(*picture.shape, 2)
        return np.asarray(cv2.dft(pairs)).view(np.complex64)[..., 0]
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
    return _unpacked(np.asarray(cv2.dft(np.ascontiguousarray(picture))))


def _unpacked(packed: npt.NDArray[np.float32]) -> npt.NDArray[np.complex64]:
    """The half plane (rows, columns // 2 + 1) of a real picture's transform from OpenCV's packed form: real and
    imaginary parts side by side, and one below the other in the columns whose rows are transforms of real numbers."""
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


def irfft_rows(spectra: npt.NDArray[np.complexfloating], columns: int) -> npt.NDArray[np.float32]:
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
