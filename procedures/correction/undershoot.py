"""Dark rims at edges: a corrected picture is bounded by the flat parts near it, where its samples are not darker."""

import numpy as np
import numpy.typing as npt

Single = npt.NDArray[np.float32]

FLAT_PX, REACH_PX = 5, 8
"""Side of the window that must be flat, and its largest distance from what it bounds."""
FLAT = 2.0
"""Standard deviation of a flat window, relative to the noise."""


def bounded(u: Single, samples: Single, noise: Single) -> Single:
    """The picture (C, n, n), at most one standard deviation of the noise below the darkest flat part near it.

    samples : (C, n, n) the picture before deblurring; noise : (C, n, n) standard deviation of its samples
    """
    import cv2

    reach, out = np.ones((2 * REACH_PX + 1,) * 2, np.uint8), np.empty_like(u)
    for restored, before, sigma, bound in zip(u, samples, noise, out, strict=True):
        mean = cv2.blur(before, (FLAT_PX, FLAT_PX))
        variance = cv2.blur(before * before, (FLAT_PX, FLAT_PX)) - mean * mean
        least = cv2.erode(np.where(variance < (FLAT * sigma) ** 2, mean, np.float32(np.inf)), reach) - sigma
        bound[...] = np.where((least < before) & (least > restored), least, restored)
    return out
