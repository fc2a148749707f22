"""The part of a frame in which motion paths are looked for: some of the flat part, and what lies at other depths."""

from __future__ import annotations

import numpy as np

from procedures.restoration.masks.blur_operator import Array

Window = tuple[slice, slice]

FLAT = 72
"""Rows and columns of the flat part that are held at least, pixels: nine tiles tell its masks."""
FARTHEST = 0.3
"""Difference of depth, of the flat part's, beyond which more of it tells paths no better apart."""
STEP = 8
"""Between the places where a window may begin, pixels."""
HEIGHTS = (0.6, 0.8, 1.0, 1.25, 1.6)
"""Of the windows that are compared, over a square's."""


def search_window(z: Array, flat: Window, half: float, w: Array, pixels: int) -> Window:
    """Rows and columns of at most `pixels` of a frame that hold most detail at depths other than the flat part's.

    z : photographs (P, 1, H, W); half : w of the flat part; w : rough depth (H, W).
    """
    H, W = w.shape
    if pixels >= H * W:
        return slice(0, H), slice(0, W)
    told = np.minimum(np.abs(w / half - 1), FARTHEST)[1:, 1:] * sum(
        np.diff(a, axis=0)[:, 1:] ** 2 + np.diff(a, axis=1)[1:] ** 2 for a in z[:, 0]
    )
    total = np.pad(np.cumsum(np.cumsum(told, axis=0), axis=1), ((2, 0), (2, 0)))
    found = max(
        (
            (float(total[y + h, x + n] - total[y, x + n] - total[y + h, x] + total[y, x]), (y, x, h, n))
            for h, n in _sizes((H, W), pixels)
            for y in _begins(flat[0], h, H)
            for x in _begins(flat[1], n, W)
        ),
        default=None,
    )
    if found is None:
        return slice(0, H), slice(0, W)
    y, x, h, n = found[1]
    return slice(y, y + h), slice(x, x + n)


def within(flat: Window, window: Window) -> Window:
    """What of the flat part lies in a window, told in the window's own pixels."""
    rows, columns = (
        slice(max(part.start, seen.start) - seen.start, min(part.stop, seen.stop) - seen.start)
        for part, seen in zip(flat, window, strict=True)
    )
    return rows, columns


def _sizes(shape: tuple[int, int], pixels: int) -> set[tuple[int, int]]:
    """Heights and widths of windows that are compared."""
    H, W = shape
    heights = (min(max(int(part * pixels**0.5), pixels // W), H) for part in HEIGHTS)
    return {(h, min(pixels // h, W)) for h in heights}


def _begins(flat: slice, length: int, size: int) -> list[int]:
    """Where windows of this length begin that hold enough of the flat part."""
    held = min(FLAT, flat.stop - flat.start, length)
    places = [*range(0, size - length, STEP), size - length]
    return [at for at in places if min(at + length, flat.stop) - max(at, flat.start) >= held]
