"""Photographs among several that show another scene than the rest."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, shift

from procedures.restoration.masks.blur_operator import Array

FINE_PX, COARSE_PX = 3.0, 9.0
"""Detail that is looked at lies between: blur of another form leaves it alike, another scene has other such detail."""
UNLIKE, ALIKE = 0.35, 0.5
"""Correlation up to which a photograph is unlike most it is held against, and from which it is like them. Real shake
leaves 0.65 and more of one scene, 0.11 at most of two."""
MOST_HELD = 6
"""Photographs that each is held against, at most."""


def odd_photographs(photographs: Array) -> list[int]:
    """Those of three photographs or more (P, H, W) that show another scene than the rest, which are like each other.

    None where that cannot be told: of two photographs, or where half of them or more are unlike.
    """
    count = len(photographs)
    if count < 3:
        return []
    detail = [gaussian_filter(one, FINE_PX) - gaussian_filter(one, COARSE_PX) for one in photographs]
    usual = [_usual([_likeness(detail[i], detail[j]) for j in _held_against(i, count)]) for i in range(count)]
    odd = [i for i, likeness in enumerate(usual) if likeness < UNLIKE]
    rest = [likeness for likeness in usual if likeness >= UNLIKE]
    return odd if 2 * len(odd) < count and min(rest) > ALIKE else []


def _usual(likenesses: list[float]) -> float:
    """The middle one; of two the higher, which of three photographs only the odd one lacks."""
    return float(np.quantile(likenesses, 0.5, method="higher"))


def _held_against(i: int, count: int) -> list[int]:
    step = max((count - 1) // MOST_HELD, 1)
    return [(i + n) % count for n in range(1, count, step)]


def _likeness(a: Array, b: Array) -> float:
    """Correlation of two pictures where they lie most alike."""
    import cv2

    window = cv2.createHanningWindow(a.shape[::-1], cv2.CV_64F)
    (x, y), _ = cv2.phaseCorrelate(np.asarray(b), np.asarray(a), window)
    inner = tuple(slice(n // 8, n - n // 8) for n in a.shape)
    moved = shift(b, (y, x), order=1, mode="nearest")
    return max(float(np.corrcoef(a[inner].ravel(), one[inner].ravel())[0, 1]) for one in (moved, b))
