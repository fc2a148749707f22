"""Error of JPEG's coding, from the file's quantisation tables and the coefficients that survived them.

A coefficient that is not rounded to zero is wrong by a twelfth of the step's square, on average. Those that are rounded
to zero follow a Laplace distribution (Reininger and Gibson 1983), whose width the others show.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.fft import dctn

BLOCK = 8
LUMINANCE = (0.299, 0.587, 0.114)
MOST_BLOCKS = 20_000


def coding_error(levels: npt.NDArray[np.uint8], steps: Sequence[int]) -> float:
    """Standard deviation of the error of luminance by coding, as part of white's level.

    levels : (H, W, 1 or 3); steps : the 64 of luminance, row by row
    """
    step = np.asarray(steps, dtype=np.float64).reshape(BLOCK, BLOCK)
    blocks = _blocks(levels @ np.array(LUMINANCE) if levels.shape[2] == 3 else levels[..., 0].astype(np.float64))
    zero = np.abs(dctn(blocks - 128, axes=(1, 2), norm="ortho")) < step / 2
    share = np.clip(zero.mean(axis=0), 1e-9, 1 - 0.5 / len(blocks))
    variance = (1 - share) * step**2 / 12 + share * _laplace_variance(share, step / 2)
    return float(np.sqrt(variance.mean()) / 255)  # the transform is orthonormal


def _laplace_variance(share: npt.NDArray[np.float64], limit: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Variance within the limits of a Laplace distribution of which this share lies within them."""
    t = -np.log1p(-share)  # limit over the distribution's scale
    scale = limit / t
    return np.asarray(scale**2 * (2 - np.exp(-t) * (t**2 + 2 * t + 2)) / share)


def _blocks(plane: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The whole blocks (N, 8, 8) of a plane, at most `MOST_BLOCKS`."""
    rows, columns = (size // BLOCK * BLOCK for size in plane.shape)
    tiled = plane[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).swapaxes(1, 2)
    blocks = tiled.reshape(-1, BLOCK, BLOCK)
    return blocks[:: max(1, len(blocks) // MOST_BLOCKS)]
