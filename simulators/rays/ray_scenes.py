"""Scenes for `rays`, most of them with depth and an open aperture, and their textures."""

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
import numpy.typing as npt

from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, X_CORNER_BLOCKS, Chart
from simulators.rays.path_tracer import Box, InfinitePlane, Material, RayScene, Rectangle, Shape, Sphere, ThinLensCamera
from simulators.rays.ray_shapes import Vector
from simulators.world.scene import INK, PAPER

Texture = npt.NDArray[np.float64]

GREY = Material((0.7, 0.7, 0.7))
LAMP: Vector = (14.0, 12.5, 10.5)  # radiance of the lamps: a sheet of white paper under them is about 1


def chart_texture(chart: Chart, texels_per_cell: int = 2, margin_cells: int = 16) -> Texture:
    """The printed chart with its white margin, as reflectance; texels that the x-corners halve are grey."""
    k, block = texels_per_cell, BLOCK * texels_per_cell
    black = np.zeros((BLOCKS * block, BLOCKS * block))
    black[block:-block, block:-block] = np.kron(1 - chart.cells, np.ones((k, k)))
    for column, row in BLACK_BLOCKS:
        black[row * block : (row + 1) * block, column * block : (column + 1) * block] = 1.0
    y, x = np.abs(np.indices((block, block)) - (block - 1) / 2)
    for column, row in X_CORNER_BLOCKS:
        corner = np.where(y > x, 1.0, np.where(y == x, 0.5, 0.0))
        black[row * block : (row + 1) * block, column * block : (column + 1) * block] = corner
    return PAPER + (INK - PAPER) * np.pad(black, margin_cells * k)


def text_texture(lines: tuple[str, ...], width: int = 600) -> Texture:
    """Lines of black print on white paper, as reflectance, 60 texels high each."""
    import cv2

    page = np.full((60 * len(lines) + 20, width), 255, np.uint8)
    for i, line in enumerate(lines):
        cv2.putText(page, line, (20, 50 + 60 * i), cv2.FONT_HERSHEY_COMPLEX, 1.4, 0, 2, cv2.LINE_AA)
    return np.asarray(INK + (PAPER - INK) * page / 255.0, np.float64)


def dead_leaves(rng: np.random.Generator, side: int = 256, smallest: float = 3.0, largest: float = 60.0) -> Texture:
    """Discs of random colour that cover each other, (side, side, 3): as many of each size as a natural picture has.

    Radii have density r^-3 between the two given, in texels: the picture then looks alike at every scale (Lee, Mumford,
    Huang 2001).
    """
    places, picture = np.arange(side), np.zeros((side, side, 3))
    bare, left = np.ones((side, side), bool), side * side
    while left:
        u = rng.random()
        radius = 1.0 / np.sqrt(u / smallest**2 + (1 - u) / largest**2)
        cx, cy = rng.uniform(-largest, side + largest, 2)
        colour = rng.uniform(0.05, 0.85) * rng.uniform(0.6, 1.0, 3)
        rows, columns = (slice(int(max(c - radius, 0)), int(min(max(c + radius + 1, 0), side))) for c in (cy, cx))
        visible = bare[rows, columns]  # the slices contain the whole leaf
        if not visible.any():
            continue
        leaf = visible & ((places[columns] - cx) ** 2 + (places[rows, None] - cy) ** 2 < radius**2)
        picture[rows, columns][leaf] = colour
        visible[leaf] = False
        left -= int(np.count_nonzero(leaf))
    return picture


def panel(left: float, top: float, z: float, width: float, height: float, texture: Texture | None = None) -> Rectangle:
    """An upright sheet that faces the camera: texture, or white paper."""
    white = (PAPER, PAPER, PAPER) if texture is None else (1.0, 1.0, 1.0)
    return Rectangle((left, top, z), (width, 0.0, 0.0), (0.0, height, 0.0), Material(white, texture=texture))


def ceiling_lamp(x: float, y: float, z: float, width: float, depth: float, radiance: Vector = LAMP) -> Rectangle:
    """A lamp centred there that shines downwards."""
    corner = (x - width / 2, y, z - depth / 2)
    return Rectangle(corner, (0.0, 0.0, depth), (width, 0.0, 0.0), Material((0.0, 0.0, 0.0), emission=radiance))


def room(rows: int = 120, columns: int = 160) -> tuple[RayScene, ThinLensCamera]:
    """A closed room with coloured walls, a box and a shining ball under a lamp, all sharp: mostly indirect light."""
    walls: list[Shape] = [
        InfinitePlane((0, 500, 0), (0, -1, 0), GREY),
        InfinitePlane((0, -500, 0), (0, 1, 0), GREY),
        InfinitePlane((-650, 0, 0), (1, 0, 0), Material((0.6, 0.1, 0.08))),
        InfinitePlane((650, 0, 0), (-1, 0, 0), Material((0.1, 0.45, 0.15))),
        InfinitePlane((0, 0, 1500), (0, 0, -1), GREY),
        InfinitePlane((0, 0, -600), (0, 0, 1), GREY),
    ]
    things: list[Shape] = [
        ceiling_lamp(0, -499, 500, 400, 400),
        Box((-250, 250, 1100), (140, 250, 140), GREY, turn_rad=0.35),
        Sphere((250, 350, 850), 150, Material((0.4, 0.4, 0.5), gloss=0.2, exponent=20)),
    ]
    camera = ThinLensCamera(
        rows, columns, focal_mm=35, pitch_um=36e3 / columns, position_mm=(0, 0, -550), target_mm=(0, 130, 1000)
    )
    return RayScene([*walls, *things]), camera


def chart_in_depth(rows: int = 120, columns: int = 160) -> tuple[RayScene, ThinLensCamera]:
    """A corner of the noise chart in focus on a bench; print behind it and a ball before it are far out of focus."""
    corner = chart_texture(Chart.from_seed())[: 2 * 72, : 2 * 72]
    text = text_texture(("The quick brown fox", "jumps over 13 lazy", "dogs; 0123456789"))
    things: list[Shape] = [
        InfinitePlane((0, 260, 0), (0, -1, 0), Material((0.45, 0.33, 0.22))),
        InfinitePlane((0, 0, 3000), (0, 0, -1), Material((0.35, 0.45, 0.55))),
        panel(-290, -190, 1500, 400, 400, corner),
        panel(120, -420, 2500, 720, 240, text),
        panel(-900, -500, 2400, 420, 560),
        Sphere((230, 130, 1000), 110, Material((0.7, 0.25, 0.1), gloss=0.15, exponent=30)),
        Box((330, 160, 1700), (90, 100, 90), GREY, turn_rad=0.5),
        ceiling_lamp(-500, -900, 900, 700, 700, (9.0, 8.5, 8.0)),
        ceiling_lamp(700, -900, 1500, 500, 500, (6.0, 6.5, 8.0)),
    ]
    camera = ThinLensCamera(
        rows, columns, focal_mm=50, f_number=1.4, focus_mm=1500, pitch_um=24e3 / columns, target_mm=(0, 0, 1500)
    )
    return RayScene(things, sky=(0.15, 0.17, 0.2)), camera


def steps_from_a_slider(rows: int = 120, columns: int = 160) -> tuple[RayScene, ThinLensCamera]:
    """Sheets of dead leaves at four distances, from a camera that moves sideways while its shutter is open."""
    rng = np.random.default_rng(7)
    things: list[Shape] = [
        InfinitePlane((0, 400, 0), (0, -1, 0), GREY),
        InfinitePlane((0, 0, 3600), (0, 0, -1), Material((0.5, 0.5, 0.45))),
        ceiling_lamp(0, -1000, 1500, 900, 900, (7.0, 6.5, 6.0)),
    ]
    for i, z in enumerate((1000.0, 1500.0, 2200.0, 3200.0)):
        step, leaves = 0.23 * z, dead_leaves(rng, smallest=24.0, largest=90.0)
        things.append(panel((i - 2) * step, -0.15 * z, z, 0.2 * z, 0.3 * z, leaves[:, :171]))
    camera = ThinLensCamera(
        rows, columns, focal_mm=50, f_number=1.4, focus_mm=1500, pitch_um=48e3 / columns, target_mm=(0, 0, 1500),
        exposure_s=0.02, velocity_mm_s=(600.0, 0.0, 0.0),
    )  # fmt: skip
    return RayScene(things, sky=(0.2, 0.2, 0.22)), camera


@cache
def leaves_in_depth(rows: int = 120, columns: int = 160, f_number: float = 2.0) -> tuple[RayScene, ThinLensCamera]:
    """A wall of dead leaves that recedes to the left and two sheets of them before it, all beyond the plane in focus.

    Blur then grows with distance only, up to that of infinity, and is visible in the texture nearly everywhere.
    """
    printed = [Material((1.0, 1.0, 1.0), texture=leaves) for leaves in _three_leaves()]
    things: list[Shape] = [
        Rectangle((-800, -500, 2400), (1400, 0, -1100), (0, 1000, 0), printed[0]),
        Rectangle((-330, -290, 1650), (260, 0, 0), (0, 330, 0), printed[1]),
        Rectangle((-40, 20, 1350), (210, 0, 0), (0, 190, 0), printed[2]),
        ceiling_lamp(-500, -1000, 600, 900, 900, (11.0, 10.5, 10.0)),
        ceiling_lamp(600, -1000, 600, 700, 700, (9.0, 9.5, 10.5)),
    ]
    camera = ThinLensCamera(
        rows, columns, focal_mm=50, f_number=f_number, focus_mm=1000, pitch_um=24e3 / columns, target_mm=(0, 0, 1000)
    )
    return RayScene(things, sky=(0.3, 0.31, 0.33)), camera


@cache
def _three_leaves() -> tuple[Texture, ...]:
    """Cached leaves of that scene, which are the same at every aperture."""
    rng = np.random.default_rng(11)
    return tuple(dead_leaves(rng, side=384, largest=24.0) for _ in range(3))


SCENES: Mapping[str, Callable[[int, int], tuple[RayScene, ThinLensCamera]]] = {
    "room": room,
    "chart-in-depth": chart_in_depth,
    "steps-from-a-slider": steps_from_a_slider,
}
"""Scenes by name: functions of rows and columns that give scene and camera."""
