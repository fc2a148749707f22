"""Outlier frames: photographs among several that show another scene than the rest."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, shift

from procedures.restoration.masks.blur_operator import Array

FINE_PX, COARSE_PX = 3.0, 9.0
"""Band of detail that is compared: blur of another form preserves it, another scene differs in it."""
UNLIKE, ALIKE = 0.35, 0.5
"""Correlation up to which a photograph differs from most others, and above which it agrees. Real shake leaves 0.65 and
more for one scene, 0.11 at most for two."""
MOST_COMPARED = 6
"""Maximum number of photographs that each is compared with."""


def outlier_frames(photographs: Array) -> list[int]:
    """Indices of those of three photographs or more (P, H, W) that show another scene than the rest.

    Empty where that is undecidable: for two photographs, or where half of them or more differ.
    """
    count = len(photographs)
    if count < 3:
        return []
    detail = [gaussian_filter(one, FINE_PX) - gaussian_filter(one, COARSE_PX) for one in photographs]
    typical = [_median([_correlation(detail[i], detail[j]) for j in _compared_with(i, count)]) for i in range(count)]
    outliers = [i for i, likeness in enumerate(typical) if likeness < UNLIKE]
    rest = [correlation for correlation in typical if correlation >= UNLIKE]
    return outliers if 2 * len(outliers) < count and min(rest) > ALIKE else []


def _median(correlations: list[float]) -> float:
    """The median; of two the higher, which among three photographs only the outlier lacks."""
    return float(np.quantile(correlations, 0.5, method="higher"))


def _compared_with(i: int, count: int) -> list[int]:
    step = max((count - 1) // MOST_COMPARED, 1)
    return [(i + n) % count for n in range(1, count, step)]


def _correlation(a: Array, b: Array) -> float:
    import cv2

    window = cv2.createHanningWindow(a.shape[::-1], cv2.CV_64F)
    (x, y), _ = cv2.phaseCorrelate(np.asarray(b), np.asarray(a), window)
    inner = tuple(slice(n // 8, n - n // 8) for n in a.shape)
    shifted = shift(b, (y, x), order=1, mode="nearest")
    return max(float(np.corrcoef(a[inner].ravel(), image[inner].ravel())[0, 1]) for image in (shifted, b))
