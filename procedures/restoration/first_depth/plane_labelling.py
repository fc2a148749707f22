"""Depth from planes of the surroundings: every pixel takes the plane that fits its cost best, its own or a neighbour's.

Where noise hides a depth step, matching level by level slopes from one side to the other, and nothing says where the
sides meet. A plane about the middle of such a slope fits the depths around it badly, those on either side fit well; a
pixel that has to choose between those jumps (as edge-preserving filters of the Kuwahara family do).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.numerics.kernel_cache import jitted
from procedures.restoration.first_depth.planes import TRUNCATE, fitted
from procedures.restoration.first_depth.semi_global_matching import DIRECTIONS
from procedures.restoration.first_depth.slanted_matching import sheared
from procedures.restoration.masks.array_loops import gaussian
from procedures.restoration.masks.blur_operator import Array

F32 = NDArray[np.float32]


@dataclass(frozen=True)
class Choice:
    """How planes are offered and chosen.

    sigma : of the windows planes are fitted under, pixels; far : distances from which neighbours' planes come, pixels;
    misfit : cost of a plane per mean square that its window's depths leave it by, 1 / pixel^2; change, jump : penalty
    of a pixel of w between neighbours' planes, and the largest; rounds : each from the last one's depths.
    """

    sigma: float = 8.0
    far: tuple[float, ...] = (12.0, 20.0)
    misfit: float = 60.0
    change: float = 10.0
    jump: float = 4.0
    rounds: int = 3


@dataclass(frozen=True)
class Offers:
    """Planes offered to every pixel, (H, W, K) each: value there, slopes down and across, misfit in their windows."""

    value: F32
    down: F32
    across: F32
    left: F32


def offers(w: Array, sigma: float, far: tuple[float, ...]) -> Offers:
    """The plane about each pixel of w (H, W), and those about eight others at every distance `far` from it."""
    own = fitted(w, np.ones_like(w), sigma)
    left = gaussian((w - own.value) ** 2, sigma, TRUNCATE)
    (H, W), (y, x) = w.shape, np.indices(w.shape)
    shape = (H, W, 1 + 8 * len(far))
    value, down, across, misfit = (np.empty(shape, np.float32) for _ in range(4))
    places = [(d, t) for d in far for t in np.arange(8) * np.pi / 4]
    for k, (d, t) in enumerate([(0.0, 0.0), *places]):
        there = np.clip(y + round(d * np.sin(t)), 0, H - 1), np.clip(x + round(d * np.cos(t)), 0, W - 1)
        down[..., k], across[..., k], misfit[..., k] = own.down[there], own.across[there], left[there]
        value[..., k] = own.value[there] + own.down[there] * (y - there[0]) + own.across[there] * (x - there[1])
    return Offers(value, down, across, misfit)


def chosen(volume: F32, first: float, step: float, w: Array, beyond: float, choice: Choice) -> Array:
    """w (H, W) made of the planes chosen.

    volume : costs (H, W, L) of the levels first, first + step, ...; beyond : cost outside them; w : where to begin.
    """
    for _ in range(choice.rounds):
        planes = offers(w, choice.sigma, choice.far)
        cost = choice.misfit * planes.left
        for k in range(cost.shape[2]):
            cost[..., k] += sheared(volume, (planes.value[..., k].astype(np.float64) - first) / step, 1, beyond)[..., 0]
        total = np.zeros_like(cost)
        for dy, dx in DIRECTIONS:
            _along(cost, planes.value, planes.down, planes.across, total, dy, dx, choice.change, choice.jump)
        best = total.argmin(axis=2)[..., None]
        w = np.take_along_axis(planes.value, best, axis=2)[..., 0].astype(np.float64)
    return w


@jitted(fastmath=True)
def _along(
    cost: F32, value: F32, down: F32, across: F32, total: F32, dy: int, dx: int, change: float, jump: float
) -> None:
    """Add to `total` the least cost of every path arriving along (dy, dx), as in `matching`; labels are planes."""
    height, width, planes = cost.shape
    before = np.zeros((width, planes), np.float32)
    now = np.zeros((width, planes), np.float32)
    for n in range(height):
        y = n if dy >= 0 else height - 1 - n
        for m in range(width):
            x = m if dx >= 0 else width - 1 - m
            py, px = y - dy, x - dx
            inside = 0 <= px < width and 0 <= py < height
            came = now[px if inside else 0] if dy == 0 else before[px if inside else 0]
            least = came.min()
            for k in range(planes):
                best = np.float32(jump) if inside else np.float32(0)
                if inside:
                    for j in range(planes):
                        # the other's plane, continued to here
                        there = value[py, px, j] + dy * down[py, px, j] + dx * across[py, px, j]
                        best = min(best, came[j] - least + change * abs(there - value[y, x, k]))
                now[x, k] = cost[y, x, k] + best
                total[y, x, k] += now[x, k]
        before, now = now, before
