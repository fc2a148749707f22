"""Labels over a whole cost volume: semi-global matching along straight paths (Hirschmueller 2008)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.numerics.compiled import jitted


@jitted(fastmath=True)
def _along(cost: NDArray[np.float32], total: NDArray[np.float32], dy: int, dx: int, small: float, large: float) -> None:
    """Add to `total` the cost of the best path that arrives along (dy, dx)."""
    height, width, labels = cost.shape
    before = np.zeros((width, labels), np.float32)
    now = np.zeros((width, labels), np.float32)
    for n in range(height):
        y = n if dy >= 0 else height - 1 - n
        for m in range(width):
            x = m if dx >= 0 else width - 1 - m
            here = cost[y, x]
            path = now[x]
            px, py = x - dx, y - dy
            if px < 0 or px >= width or py < 0 or py >= height:
                for k in range(labels):
                    path[k] = here[k]
            else:
                came = now[px] if dy == 0 else before[px]
                least = came[0]
                for k in range(1, labels):
                    least = min(least, came[k])
                for k in range(labels):
                    best = min(came[k], least + large)
                    if k > 0:
                        best = min(best, came[k - 1] + small)
                    if k < labels - 1:
                        best = min(best, came[k + 1] + small)
                    path[k] = here[k] + best - least
            for k in range(labels):
                total[y, x, k] += path[k]
        before, now = now, before


DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


def semi_global(cost: NDArray[np.float32], small: float, large: float) -> NDArray[np.float32]:
    """Cost volume aggregated along straight paths, (H, W, L); its minimum is the matched label.

    cost : (H, W, L); small : penalty of a change by one label between neighbours; large : of any other change.
    """
    total = np.zeros_like(cost)
    for dy, dx in DIRECTIONS:
        _along(cost, total, dy, dx, small, large)
    return total
