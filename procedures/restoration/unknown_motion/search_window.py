"""Window of a frame for the search of motion paths: some of the flat part, and parts at other depths."""

import numpy as np

from procedures.restoration.masks.blur_operator import Array

Window = tuple[slice, slice]

FLAT = 72
"""Smallest number of rows and columns of the flat part, pixels: nine tiles determine its masks."""
FARTHEST = 0.3
"""Relative difference of depth above which a larger one does not separate paths better."""
STEP = 8
"""Step of the window's position, pixels."""
HEIGHTS = (0.6, 0.8, 1.0, 1.25, 1.6)
"""Heights of the windows that are compared, relative to a square's."""


def search_window(z: Array, flat: Window, half: float, w: Array, pixels: int) -> Window:
    """Rows and columns of at most `pixels` with most detail nearer and farther than the flat part's w, `half`. Roots of
    both are added: paths from one side alone draw wrong masks at the other's depths."""
    H, W = w.shape
    if pixels >= H * W:
        return slice(0, H), slice(0, W)
    texture = sum(np.diff(a, axis=0)[:, 1:] ** 2 + np.diff(a, axis=1)[1:] ** 2 for a in z[:, 0])
    differs = np.clip(w / half - 1, -FARTHEST, FARTHEST)[1:, 1:]
    sides = np.stack([texture * np.maximum(differs, 0), texture * np.maximum(-differs, 0)])
    total = np.pad(np.cumsum(np.cumsum(sides, axis=1), axis=2), ((0, 0), (2, 0), (2, 0)))

    def detail(y: int, x: int, h: int, n: int) -> float:
        each = total[:, y + h, x + n] - total[:, y, x + n] - total[:, y + h, x] + total[:, y, x]
        return float(np.sqrt(np.maximum(each, 0)).sum())

    places = (
        (y, x, h, n)
        for h, n in _sizes((H, W), pixels)
        for y in _positions(flat[0], h, H)
        for x in _positions(flat[1], n, W)
    )
    best = max(places, key=lambda place: detail(*place), default=None)
    if best is None:
        return slice(0, H), slice(0, W)
    y, x, h, n = best
    return slice(y, y + h), slice(x, x + n)


def within(flat: Window, window: Window) -> Window:
    """The part of the flat part inside a window, in the window's pixels."""
    rows, columns = (
        slice(max(part.start, frame.start) - frame.start, min(part.stop, frame.stop) - frame.start)
        for part, frame in zip(flat, window, strict=True)
    )
    return rows, columns


def _sizes(shape: tuple[int, int], pixels: int) -> set[tuple[int, int]]:
    H, W = shape
    heights = (min(max(int(part * pixels**0.5), pixels // W), H) for part in HEIGHTS)
    return {(h, min(pixels // h, W)) for h in heights}


def _positions(flat: slice, length: int, size: int) -> list[int]:
    least = min(FLAT, flat.stop - flat.start, length)
    places = [*range(0, size - length, STEP), size - length]
    return [at for at in places if min(at + length, flat.stop) - max(at, flat.start) >= least]
