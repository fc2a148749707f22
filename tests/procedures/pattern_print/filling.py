"""Filling of a path by the non-zero rule, as in a viewer, independent of the tracing of outlines."""

import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Loops = Sequence[Sequence[tuple[int, int]]]


def winding(loops: Loops, first: float, step: float, count: int) -> npt.NDArray[np.int64]:
    """Winding number (clockwise, y down) of the loops around each point (x, y) of a square grid; 0 is outside."""
    centres = first + step * np.arange(count)
    crossings = np.zeros((count, count + 1), dtype=np.int64)
    for loop in loops:
        for (x0, y0), (x1, y1) in zip(loop, [*loop[1:], loop[0]], strict=True):
            rows = np.flatnonzero((centres > min(y0, y1)) & (centres < max(y0, y1)))
            if rows.size:
                x = x0 + (centres[rows] - y0) * (x1 - x0) / (y1 - y0)
                crossings[rows, np.searchsorted(centres, x)] += 1 if y1 < y0 else -1
    return crossings.cumsum(axis=1)[:, :count]


def svg_loops(path: str) -> list[list[tuple[int, int]]]:
    """The vertices of an SVG path of M, h, v, l and z with whole numbers."""
    loops: list[list[tuple[int, int]]] = []
    for command, numbers in re.findall(r"([A-Za-z])([^A-Za-z]*)", path):
        steps = [int(number) for number in numbers.split()]
        if command == "M":
            loops.append([(steps[0], steps[1])])
        elif command != "z":
            x, y = loops[-1][-1]
            dx, dy = {"h": (*steps, 0), "v": (0, *steps), "l": tuple(steps)}[command]
            loops[-1].append((x + dx, y + dy))
    return loops
