"""The scene in front of the camera: sheets with charts, objects in front of and behind them, and illumination.

Everything is flat polygons in planes, painted from back to front, each with its exact outline.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, CELLS, EDGE_END, Chart, block_corner, edge_areas, triangles
from simulators.world.projection import ObjectPose, Projection, Segments, apply_homography, outline

Array = npt.NDArray[np.float64]

PAPER = 0.9  # reflectance of matt white paper
INK = 0.04  # reflectance of black toner


@dataclass(frozen=True)
class Shape:
    """A flat polygon of uniform reflectance with sides that do not cross: vertices (x, y) in the units of its plane."""

    vertices: tuple[tuple[float, float], ...]
    reflectance: float


@dataclass(frozen=True)
class Illumination:
    """Illumination over the frame: a second-order polynomial about a point of the sensor.

    With (u, v) = ((x, y) - centre_px) / radius_px it is
    level (1 + slope . (u, v) + bend . (u^2, u v, v^2)).
    """

    level: float = 1.0
    slope: tuple[float, float] = (0.0, 0.0)
    bend: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre_px: tuple[float, float] = (0.0, 0.0)
    radius_px: float = 1.0

    def at(self, x: Array, y: Array) -> Array:
        """Illumination at sensor points, broadcast over x and y; never negative."""
        u, v = (x - self.centre_px[0]) / self.radius_px, (y - self.centre_px[1]) / self.radius_px
        (a, b), (c, d, e) = self.slope, self.bend
        across: Array = self.level * (1 + u * (a + c * u))
        down: Array = self.level * v * (b + e * v)
        light = across + down
        if d:
            light += self.level * d * u * v
        return np.asarray(np.maximum(light, 0.0), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class PlacedChart:
    """A printed chart in space.

    pose : Pose, of the chart's centre, cell (128, 128), and of its plane
    cell_mm : float, side of one printed cell
    mirrored : bool, printed or viewed through the back: x runs to the left
    margin_cells : float, width of the white paper around the frame of blocks
    covers : tuple of Shape, objects in front of the chart, in pattern coordinates (cells)
    """

    chart: Chart
    pose: ObjectPose
    cell_mm: float
    mirrored: bool = False
    paper: float = PAPER
    ink: float = INK
    margin_cells: float = 16.0
    covers: tuple[Shape, ...] = ()

    def to_space(self) -> Array:
        """Matrix from pattern coordinates (x, y, 1) to space in mm, homogeneous, (3, 3)."""
        c, middle = self.cell_mm, CELLS / 2
        across = -c if self.mirrored else c
        centred = np.array([[across, 0.0, -across * middle], [0.0, c, -c * middle], [0.0, 0.0, 1.0]])
        return np.asarray(self.pose.plane_to_space() @ centred, dtype=np.float64)

    def sheet(self) -> Array:
        """Corners of the paper in pattern coordinates, (4, 2)."""
        low = -BLOCK - self.margin_cells
        high = (EDGE_END if self.chart.edges else BLOCK * (BLOCKS - 1)) + self.margin_cells
        return np.array([[low, low], [high, low], [high, high], [low, high]])


@dataclass(frozen=True)
class Wall:
    """A frontal plane behind everything, with shapes drawn on it in mm from the optical axis."""

    distance_mm: float = 4000.0
    reflectance: float = 0.35
    shapes: tuple[Shape, ...] = ()

    def to_space(self) -> Array:
        """Matrix from points (x_mm, y_mm, 1) of the wall to space, (3, 3)."""
        return np.diag([1.0, 1.0, self.distance_mm])


@dataclass(frozen=True)
class Scene:
    """Everything in view of the camera."""

    charts: tuple[PlacedChart, ...] = ()
    wall: Wall = field(default_factory=Wall)
    light: Illumination = field(default_factory=Illumination)

    def by_distance(self) -> list[PlacedChart]:
        """The charts, farthest first."""
        return sorted(self.charts, key=lambda one: -one.pose.centre_mm[2])


@dataclass(frozen=True, eq=False)
class Stroke:
    """One outline on the sensor, painted over the background (opaque) or added to it (print on paper).

    `chart` is the chart it belongs to, None for shapes on the wall.
    """

    segments: Segments
    reflectance: float
    opaque: bool
    chart: PlacedChart | None

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest and largest x, then y, in sensor pixels."""
        ends = self.segments.starts
        (x0, y0), (x1, y1) = ends.min(axis=0), ends.max(axis=0)
        return float(x0), float(x1), float(y0), float(y1)


def strokes(scene: Scene, projection: Projection) -> Iterator[Stroke]:
    """The scene as outlines on the sensor, from back to front."""
    for shape in scene.wall.shapes:
        yield _painted(shape, projection, scene.wall.to_space(), None)
    for placed in scene.by_distance():
        H = placed.to_space()
        corners = tuple((float(x), float(y)) for x, y in placed.sheet())
        yield _painted(Shape(corners, placed.paper), projection, H, placed)
        yield Stroke(_on_sensor(chart_outlines(placed.chart), projection, H), placed.ink - placed.paper, False, placed)
        for shape in placed.covers:
            yield _painted(shape, projection, H, placed)


def chart_outlines(chart: Chart) -> Segments:
    """The outlines of all black areas of the chart, in cells, cut into sides of one cell; the inside adds 1."""
    # sides between a black and a white cell: downwards they add the value on their right minus that on their left
    black = np.pad(1.0 - chart.cells, 1)
    i, j = np.nonzero(np.diff(black[1:-1, :], axis=1))
    upright = np.diff(black[1:-1, :], axis=1)[i, j]
    top = np.column_stack([j, i]).astype(np.float64)
    k, m = np.nonzero(np.diff(black[:, 1:-1], axis=0))
    flat = -np.diff(black[:, 1:-1], axis=0)[k, m]
    left = np.column_stack([m, k]).astype(np.float64)
    starts, ends = np.concatenate([top, left]), np.concatenate([top + np.array([0, 1]), left + np.array([1, 0])])
    noise_outlines = Segments(starts, ends, np.concatenate([upright, flat]))
    parts = [noise_outlines]
    for column, row in BLACK_BLOCKS:
        x, y = block_corner(column, row)
        square = np.array([[x, y], [x + BLOCK, y], [x + BLOCK, y + BLOCK], [x, y + BLOCK]])
        parts.append(_subdivided(outline(square), BLOCK))
    parts.extend(_subdivided(outline(triangle), BLOCK) for triangle in triangles())
    if chart.edges:
        parts.extend(_subdivided(outline(area), CELLS) for area in edge_areas())
    columns = zip(*((part.starts, part.ends, part.weights) for part in parts), strict=True)
    return Segments(*map(np.concatenate, columns))


def _subdivided(segments: Segments, n: int) -> Segments:
    """Split each segment into n equal ones: straight lines bend under lens distortion."""
    t = np.linspace(0.0, 1.0, n + 1)[None, :, None]
    points = segments.starts[:, None] * (1 - t) + segments.ends[:, None] * t
    return Segments(points[:, :-1].reshape(-1, 2), points[:, 1:].reshape(-1, 2), np.repeat(segments.weights, n))


def _painted(shape: Shape, projection: Projection, H: Array, chart: PlacedChart | None) -> Stroke:
    sides = _subdivided(outline(np.array(shape.vertices, dtype=np.float64)), 64)
    return Stroke(_on_sensor(sides, projection, H), shape.reflectance, True, chart)


def _on_sensor(segments: Segments, projection: Projection, to_space: Array) -> Segments:
    """Project the outlines of a plane; reversed if the map mirrors, so that the inside stays inside."""
    H = projection.pinhole() @ to_space
    starts, ends = (projection.distort(apply_homography(H, p)) for p in (segments.starts, segments.ends))
    return Segments(starts, ends, segments.weights * np.sign(np.linalg.det(H)))
