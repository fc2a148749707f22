"""How one photograph lies to another, told by their likeness whatever their light.

References
----------
Evangelidis, Psarakis, Parametric image alignment using enhanced correlation coefficient maximization, IEEE TPAMI 30
(2008), as OpenCV has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

ROUNDS, SETTLED = 60, 1e-7
COARSE_PX = 256
"""Side of the small copies in which the first guess is made."""
SMOOTHED = 5
"""Side of the window that both are smoothed by, pixels."""


def affine_between(first: Single, second: Single, clear: npt.NDArray[np.bool_]) -> Array | None:
    """The affine map (2, 3) from points (x, y) of the first picture to the second's, or None where there is none.

    clear : where the first picture counts
    """
    import cv2  # here: it is slow to load

    factor = min(1.0, COARSE_PX / min(first.shape))
    guess = _shift_between(first, second, factor)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ROUNDS, SETTLED)
    mask: npt.NDArray[Any] = clear.astype(np.uint8)
    try:
        _, found = cv2.findTransformECC(first, second, guess, cv2.MOTION_AFFINE, stop, mask, SMOOTHED)
    except cv2.error:
        return None
    return np.asarray(found, dtype=np.float64)


def _shift_between(first: Single, second: Single, factor: float) -> Single:
    """A shift of whole pixels, from small copies."""
    import cv2

    a, b = (cv2.resize(one, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) for one in (first, second))
    window = cv2.createHanningWindow(a.shape[::-1], cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate(np.asarray(a - a.mean()), np.asarray(b - b.mean()), window)
    return np.array([[1, 0, x / factor], [0, 1, y / factor]], dtype=np.float32)
