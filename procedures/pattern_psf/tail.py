"""What the support cuts off: the far tail of the PSF, one number beside the k x k samples.

Diffraction's tail falls as 1/r^3 and carries some per cent of the energy beyond any support. Left out, it is not
noise: it is the chart blurred widely, which the outer samples of the support would take for their own. One kernel of
that shape, outside the support, with its amplitude free, keeps it out of them and tells how much was cut.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.fft

Array = npt.NDArray[np.float64]

REACH = 4
"""The tail ends at so many half-widths of the support; what lies beyond is flat over the noise region."""


def tail_border(k: int) -> int:
    """Samples of the s grid that the tail needs around a raster."""
    return REACH * (k // 2)


def tail_kernel(k: int) -> Array:
    """1/r^3 outside the central k x k samples, within a circle, of sum 1: (K, K), K odd."""
    half = tail_border(k)
    x = np.arange(-half, half + 1)
    r = np.hypot(x, x[:, None])
    support = np.maximum(np.abs(x), np.abs(x[:, None])) <= k // 2
    kernel = np.where(support | (r > half), 0.0, 1 / np.maximum(r, 1) ** 3)
    return np.asarray(kernel / kernel.sum())


def tail_column(
    u: npt.NDArray[np.float32], rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], s: int, k: int
) -> Array:
    """The chart seen through the tail, at pixels (m,): its amplitude is the energy outside over that inside.

    `u` is the chart on the s grid with a border of `tail_border`.
    """
    kernel = tail_kernel(k)
    shape = [scipy.fft.next_fast_len(n, real=True) for n in u.shape]
    product = scipy.fft.rfft2(u, shape) * scipy.fft.rfft2(kernel.astype(np.float32), shape)
    seen = scipy.fft.irfft2(product, shape)
    first = len(kernel) - 1
    return np.asarray(seen[first + s * rows, first + s * columns], dtype=np.float64)
