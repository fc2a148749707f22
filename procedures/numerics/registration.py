"""Affine registration of two photographs by their correlation, independent of their brightness.

Source: Evangelidis, Psarakis, Parametric image alignment using enhanced correlation coefficient maximization, IEEE
TPAMI 30 (2008), in OpenCV's implementation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32

MAX_ITERATIONS, TOLERANCE = 60, 1e-7
COARSE_PX = 256
"""Side of the reduced copies for the first guess."""
SMOOTHED = 5
"""Side of the smoothing window, pixels."""


def affine_between(first: Array32, second: Array32, clear: npt.NDArray[np.bool_]) -> Array | None:
    """The affine map (2, 3) from points (x, y) of the first picture to the second, or None without convergence.

    clear : mask of the valid pixels of the first picture
    """
    import cv2  # here: it is slow to load

    factor = min(1.0, COARSE_PX / min(first.shape))
    guess = _shift_between(first, second, factor)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, MAX_ITERATIONS, TOLERANCE)
    mask: npt.NDArray[Any] = clear.astype(np.uint8)
    try:
        _, matrix = cv2.findTransformECC(first, second, guess, cv2.MOTION_AFFINE, stop, mask, SMOOTHED)
    except cv2.error:
        return None
    return np.asarray(matrix, dtype=np.float64)


def _shift_between(first: Array32, second: Array32, factor: float) -> Array32:
    import cv2

    a, b = (cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) for image in (first, second))
    window = cv2.createHanningWindow(a.shape[::-1], cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate(np.asarray(a - a.mean()), np.asarray(b - b.mean()), window)
    return np.array([[1, 0, x / factor], [0, 1, y / factor]], dtype=np.float32)
