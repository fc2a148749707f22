"""Surroundings of a chart in a real room: posters, edges, cables, text; and objects covering it."""

import numpy as np
import numpy.typing as npt

from procedures.pattern import BLOCK, X_CORNERS
from simulators.world.scene import Shape

Array = npt.NDArray[np.float64]

# corners of a letter's grid, two wide and three high, connected by the strokes of letters
_STROKES = (
    ((0, 0), (1, 0)), ((0, 1), (1, 1)), ((0, 2), (1, 2)), ((0, 0), (0, 1)), ((0, 1), (0, 2)),
    ((1, 0), (1, 1)), ((1, 1), (1, 2)), ((0, 0), (1, 1)), ((0, 2), (1, 1)),
)  # fmt: skip


def random_clutter(
    rng: np.random.Generator, width_mm: float, height_mm: float, *, polygons: int = 20, lines: int = 15, words: int = 8
) -> tuple[Shape, ...]:
    """Random polygons, lines and words on a wall of this size about the optical axis."""
    size = min(width_mm, height_mm)
    shapes: list[Shape] = []
    for _ in range(polygons):
        shapes.append(polygon(rng, _spot(rng, width_mm, height_mm), size * rng.uniform(0.02, 0.2)))
    for _ in range(lines):
        ends = [_spot(rng, width_mm, height_mm) for _ in range(2)]
        shapes.append(stroke(ends[0], ends[1], size * rng.uniform(0.001, 0.01), rng.uniform(0.03, 0.9)))
    for _ in range(words):
        shapes += word(rng, _spot(rng, width_mm, height_mm), size * rng.uniform(0.01, 0.06))
    return tuple(shapes)


def polygon(rng: np.random.Generator, centre: Array, radius: float) -> Shape:
    """A star-shaped polygon of three to eight corners."""
    count = int(rng.integers(3, 9))
    # no gap of half a turn between four corners or more: the sides would cross
    turns = (np.arange(count) + rng.uniform(0, 0.8, count)) * 2 * np.pi / count
    reach = radius * rng.uniform(0.4, 1.0, len(turns))
    corners = centre + reach[:, None] * np.column_stack([np.cos(turns), np.sin(turns)])
    return _shape(corners, rng.uniform(0.03, 0.9))


def stroke(start: Array, end: Array, width: float, reflectance: float) -> Shape:
    """A straight line of some width."""
    along = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
    side = width / 2 * np.array([-along[1], along[0]])
    return _shape(np.array([start - side, end - side, end + side, start + side]), reflectance)


def word(rng: np.random.Generator, corner: Array, height: float) -> list[Shape]:
    """A line of letters of no known alphabet, in a random direction."""
    reflectance = rng.uniform(0.03, 0.2)
    turn = rng.uniform(0, 2 * np.pi)
    across = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * height
    shapes = []
    for place in range(int(rng.integers(3, 12))):
        for index in rng.choice(len(_STROKES), 4, replace=False):
            start, end = (
                corner + np.array([x * 0.5 + place * 0.75, y * 0.5]) @ across for x, y in _STROKES[int(index)]
            )
            shapes.append(stroke(start, end, height / 9, reflectance))
    return shapes


def cover(marks: int, first: int = 0, reflectance: float = 0.3) -> tuple[Shape, ...]:
    """Objects covering this number of adjacent x-corners of a chart, clockwise from `first`, in pattern coordinates.

    One square on each, larger than its block, a cell away from the noise.
    """
    shapes = []
    for centre in X_CORNERS[(first + np.arange(marks)) % len(X_CORNERS)]:
        outward = np.sign(centre - X_CORNERS.mean(axis=0)) * (abs(centre - X_CORNERS.mean(axis=0)) > BLOCK * 4)
        middle, half = centre + outward * BLOCK / 4, 0.75 * BLOCK - 1
        square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        shapes.append(_shape(middle + square, reflectance))
    return tuple(shapes)


def _spot(rng: np.random.Generator, width: float, height: float) -> Array:
    return np.array([rng.uniform(-width / 2, width / 2), rng.uniform(-height / 2, height / 2)])


def _shape(corners: Array, reflectance: float) -> Shape:
    return Shape(tuple((float(x), float(y)) for x, y in corners), float(reflectance))
