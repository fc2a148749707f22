"""A small path tracer: samples of a scene in depth, with real light falloff, indirect light, defocus and motion.

Raw samples are passed to a callback, `receive(rows, columns, colours)`, for example of a film. The count of samples per
pixel is the only state: after a pause, or a round of adaptive sampling, only the missing samples are cast.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from simulators.rays.ray_paths import RayCamera, measure_depths, trace
from simulators.rays.ray_shapes import BOX, GEOMETRY, PLANE, RECTANGLE, SPHERE, Doubles, Ints, SceneArrays, Vector

Receive = Callable[[Ints, Ints, Doubles], None]
Progress = Callable[[int, int], None]

TILE = 32  # pixels along one side of a tile
BATCH = 1 << 16  # approximate number of samples per batch


@dataclass(frozen=True)
class Material:
    """Reflection and emission of a surface.

    albedo : (red, green, blue) share of light scattered to all sides
    gloss, exponent : float, share of light scattered about the mirror direction instead, and how narrowly
    emission : (red, green, blue) radiance of a light, from the front of a rectangle (along edge u x edge v)
    texture : (rows, columns) or (rows, columns, 3) or None
        Factors of the albedo over a rectangle: columns along edge u, rows along edge v; texels are flat.
    """

    albedo: Vector = (0.5, 0.5, 0.5)
    gloss: float = 0.0
    exponent: float = 1.0
    emission: Vector = (0.0, 0.0, 0.0)
    texture: npt.NDArray[np.floating] | None = None


@dataclass(frozen=True)
class InfinitePlane:
    """All points of a plane; the normal is made a unit vector."""

    point_mm: Vector
    normal: Vector
    material: Material


@dataclass(frozen=True)
class Sphere:
    """A sphere."""

    centre_mm: Vector
    radius_mm: float
    material: Material


@dataclass(frozen=True)
class Rectangle:
    """A rectangle from a corner along two perpendicular edges; the only shape with texture or emission."""

    corner_mm: Vector
    edge_u_mm: Vector
    edge_v_mm: Vector
    material: Material


@dataclass(frozen=True)
class Box:
    """A box of these half sizes, turned about the vertical."""

    centre_mm: Vector
    half_mm: Vector
    material: Material
    turn_rad: float = 0.0


Shape = InfinitePlane | Sphere | Rectangle | Box


@dataclass(frozen=True)
class RayScene:
    """Shapes in millimetres, x right, y down, z forward, and the radiance where there is no shape."""

    shapes: Sequence[Shape]
    sky: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ThinLensCamera:
    """A thin lens in focus at one distance; a pinhole where `f_number` is infinite.

    rows, columns : int, pixels of the picture
    focal_mm, f_number, focus_mm : float
        Focal length, ratio of it to the aperture's diameter, distance of the plane in focus from the lens.
    pitch_um : float, pixel pitch of the sensor
    position_mm, target_mm : (x, y, z) position of the lens when the shutter opens, and the point it is aimed at
    exposure_s : float, time the shutter is open; a moving camera smears
    velocity_mm_s : (x, y, z) motion of the lens
    """

    rows: int
    columns: int
    focal_mm: float = 50.0
    f_number: float = np.inf
    focus_mm: float = 1000.0
    pitch_um: float = 100.0
    position_mm: Vector = (0.0, 0.0, 0.0)
    target_mm: Vector = (0.0, 0.0, 1.0)
    exposure_s: float = 0.0
    velocity_mm_s: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.focus_mm <= self.focal_mm:
            raise ValueError(f"a lens of {self.focal_mm} mm cannot focus at {self.focus_mm} mm; focus farther away")
        if self.rows < 1 or self.columns < 1 or self.f_number <= 0:
            raise ValueError(f"{self.rows} x {self.columns} pixels at f/{self.f_number}; all must be positive")


def blur_diameter_px(camera: ThinLensCamera, distance_mm: npt.ArrayLike) -> Doubles:
    """Diameter of the blur disc, in pixels, of a point at this distance along the axis."""
    aperture_mm = camera.focal_mm / camera.f_number
    astray = np.abs(1.0 - camera.focus_mm / np.asarray(distance_mm, np.float64))
    return np.asarray(astray * aperture_mm / _pixel_at_focus_mm(camera), np.float64)


def depth_map(scene: RayScene, camera: ThinLensCamera) -> Doubles:
    """Distance from the lens along its axis of the surface at each pixel's centre, (rows, columns), mm.

    Infinite where there is nothing. With `blur_diameter_px` it is the true defocus of every pixel.
    """
    depth = np.empty((camera.rows, camera.columns))
    measure_depths(build_world(scene), build_lens(camera), depth)
    return depth


def cast(
    scene: RayScene, camera: ThinLensCamera, wanted: int | Ints, receive: Receive, *, seed: int,
    taken: Ints | None = None, threads: int = 1, progress: Progress | None = None,
) -> None:  # fmt: skip
    """Cast the requested number of samples per pixel, and deliver them tile by tile.

    A sample depends on the seed, its pixel and its number alone: not on tiles, threads, pauses, or what else is cast.

    Raises ValueError if `wanted` or `taken` are not of the picture's size, or the scene has no shapes.

    wanted : int or (rows, columns) int, samples per pixel, in all
    receive : callable, takes rows (n,), columns (n,) and linear colours (n, 3); called from the caller's thread
    taken : (rows, columns) int, samples already cast for each pixel, including dropped ones
    progress : callable, called with the numbers of samples cast and to be cast
    """
    goal = _per_pixel(camera, wanted, "wanted")
    start = _per_pixel(camera, 0 if taken is None else taken, "taken")
    world, lens = build_world(scene), build_lens(camera)
    word = np.uint64(seed % 2**64)

    def trace_batch(batch: tuple[Ints, Ints, Ints]) -> tuple[Ints, Ints, Doubles]:
        row, column, number = batch
        colour = np.empty((row.size, 3))
        trace(world, lens, word, row, column, number, colour)
        return row, column, colour

    total = int(np.maximum(goal - start, 0).sum())
    done = 0
    with ThreadPoolExecutor(threads) as pool:
        for several in _groups(_batches(start, goal), 2 * threads):
            for row, column, colour in pool.map(trace_batch, several):
                receive(row, column, colour)
                done += row.size
                if progress is not None:
                    progress(done, total)


def _groups(batches: Iterator[tuple[Ints, Ints, Ints]], size: int) -> Iterator[list[tuple[Ints, Ints, Ints]]]:
    """Compute a few batches at a time to limit the memory."""
    group = []
    for batch in batches:
        group.append(batch)
        if len(group) == size:
            yield group
            group = []
    yield group


def _batches(start: Ints, goal: Ints) -> Iterator[tuple[Ints, Ints, Ints]]:
    """Rows, columns and numbers of the samples to cast, tile by tile, several batches where a tile has many."""
    rows, columns = goal.shape
    for top in range(0, rows, TILE):
        for left in range(0, columns, TILE):
            tile = np.s_[top : top + TILE, left : left + TILE]
            first, last = start[tile], goal[tile]
            step = max(1, BATCH // first.size)
            for number in range(int(first.min()), int(last.max()), step):
                low = np.maximum(first, number)
                many = np.maximum(np.minimum(last, number + step) - low, 0)
                if many.any():
                    yield _samples(low, many, top, left)


def _samples(low: Ints, many: Ints, top: int, left: int) -> tuple[Ints, Ints, Ints]:
    """One entry per sample: `many` consecutive numbers from `low` in each pixel of a tile."""
    y, x = np.indices(many.shape)
    repeats = many.ravel()
    begins = np.repeat(np.cumsum(repeats) - repeats, repeats)
    number = np.arange(begins.size) - begins + np.repeat(low.ravel(), repeats)
    return np.repeat(y.ravel() + top, repeats), np.repeat(x.ravel() + left, repeats), number


def _per_pixel(camera: ThinLensCamera, samples: int | Ints, what: str) -> Ints:
    try:
        return np.broadcast_to(np.asarray(samples, np.int64), (camera.rows, camera.columns))
    except ValueError:
        size = f"{camera.rows} x {camera.columns}"
        raise ValueError(f"the picture is {size}; got samples {what} of shape {np.shape(samples)}") from None


def build_world(scene: RayScene) -> SceneArrays:
    """The scene as arrays for the kernels."""
    if not scene.shapes:
        raise ValueError("a scene needs at least one shape; got none")
    materials = [shape.material for shape in scene.shapes]
    places, texels = [], [np.zeros((0, 3))]
    for material in materials:
        place, flat = _texels(material, sum(map(len, texels)))
        places.append(place)
        texels.append(flat)
    shining = [i for i, m in enumerate(materials) if any(m.emission) and isinstance(scene.shapes[i], Rectangle)]
    if len(shining) < sum(any(m.emission) for m in materials):
        raise ValueError("only rectangles shine; give the other shapes no emission")
    rows = [_geometry(shape) for shape in scene.shapes]
    return SceneArrays(
        np.array([kind for kind, _ in rows], np.int64),
        np.array([np.pad(row, (0, GEOMETRY - len(row))) for _, row in rows], np.float64),
        np.array([m.albedo for m in materials], np.float64),
        np.array([(m.gloss, m.exponent) for m in materials], np.float64),
        np.array([m.emission for m in materials], np.float64),
        np.array(places, np.int64),
        np.concatenate(texels),
        np.array(shining, np.int64),
        np.array(scene.sky, np.float64),
    )


def _texels(material: Material, first: int) -> tuple[tuple[int, int, int, int], Doubles]:
    """Position of the material's texels among those of all materials, and the texels (n, 3)."""
    if material.texture is None:
        return (0, 0, 0, 0), np.zeros((0, 3))
    texture = np.asarray(material.texture, np.float64)
    colours = texture if texture.ndim == 3 else np.repeat(texture[..., None], 3, axis=2)
    return (first, *colours.shape[:2], 1), colours.reshape(-1, 3)


def _geometry(shape: Shape) -> tuple[int, list[float]]:
    """Kind and numbers of a shape, as `ray_shapes` documents them."""
    if isinstance(shape, InfinitePlane):
        normal = np.array(shape.normal) / np.linalg.norm(shape.normal)
        return PLANE, [*shape.point_mm, *normal]
    if isinstance(shape, Sphere):
        return SPHERE, [*shape.centre_mm, shape.radius_mm]
    if isinstance(shape, Rectangle):
        return RECTANGLE, [*shape.corner_mm, *shape.edge_u_mm, *shape.edge_v_mm]
    c, s = np.cos(shape.turn_rad), np.sin(shape.turn_rad)
    return BOX, [*shape.centre_mm, *shape.half_mm, c, 0.0, s, 0.0, 1.0, 0.0]


def build_lens(camera: ThinLensCamera) -> RayCamera:
    """The camera as arrays for the kernels."""
    forward = np.subtract(camera.target_mm, camera.position_mm)
    forward = forward / np.linalg.norm(forward)
    right = np.cross((0.0, 1.0, 0.0), forward)
    if not right.any():
        raise ValueError("the camera cannot look straight up or down; move the target or the camera aside")
    right /= np.linalg.norm(right)
    return RayCamera(
        np.array(camera.position_mm, np.float64),
        np.array([right, np.cross(forward, right), forward]),
        np.array(camera.velocity_mm_s, np.float64) * camera.exposure_s,
        camera.focal_mm / camera.f_number / 2,
        camera.focus_mm,
        _pixel_at_focus_mm(camera),
        camera.rows,
        camera.columns,
    )


def _pixel_at_focus_mm(camera: ThinLensCamera) -> float:
    """Size of a pixel's image on the plane in focus: the sensor is at f d / (d - f) behind the lens."""
    return camera.pitch_um / 1000 * (camera.focus_mm - camera.focal_mm) / camera.focal_mm
