"""Subjects of a simulated bench other than the chart."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from simulators.camera.camera import NOMINAL_F_NUMBER, Lens, SimulatedCamera
from simulators.camera.sensor import Sensor
from simulators.camera.sheets import FlatSheet, Frame, leaves, smooth
from simulators.world.world import SinusoidalDrive

WALL_MM = (252.0, 190.0)
WALL_TEXEL_MM = 0.05
LARGEST_MM, PER_LEAF = 12.0, 100.0
"""Radius of the wall's largest leaves, the smallest being below a pixel from the near end of the rail; texels per leaf.
"""
WALL_NEAR_MM, WALL_F_NUMBER = 360.0, 16.0
"""Four times as far is well within the rail's travel. The lens is stopped down: its MTF is low beyond the near
photograph's Nyquist frequency, where detail would be folded back."""


SHAKE_HZ, SHAKE_MM = 10.0, 1.9
DIAGONAL_MM = SHAKE_MM / 1.5
ROLL_DEG, PAN_DEG = 0.5, 0.06
MOTIONS = (
    (
        *(SinusoidalDrive("x_mm", SHAKE_MM, SHAKE_HZ), SinusoidalDrive("y_mm", 0.5 * SHAKE_MM, 2 * SHAKE_HZ, 0.6)),
        *(SinusoidalDrive("roll_deg", ROLL_DEG, SHAKE_HZ, 0.4), SinusoidalDrive("pan_deg", PAN_DEG, SHAKE_HZ, 2.0)),
        SinusoidalDrive("tilt_deg", PAN_DEG, 2 * SHAKE_HZ, 1.0),
    ),
    (
        *(SinusoidalDrive("y_mm", SHAKE_MM, SHAKE_HZ), SinusoidalDrive("x_mm", 0.5 * SHAKE_MM, 2 * SHAKE_HZ, 1.1)),
        *(SinusoidalDrive("roll_deg", ROLL_DEG, SHAKE_HZ, 2.4), SinusoidalDrive("pan_deg", PAN_DEG, 2 * SHAKE_HZ, 0.3)),
        SinusoidalDrive("tilt_deg", PAN_DEG, SHAKE_HZ, 1.7),
    ),
    (
        *(SinusoidalDrive(axis, DIAGONAL_MM, SHAKE_HZ) for axis in ("x_mm", "y_mm")),
        *(
            SinusoidalDrive("x_mm", 0.5 * DIAGONAL_MM, 2 * SHAKE_HZ),
            SinusoidalDrive("y_mm", 0.5 * DIAGONAL_MM, 2 * SHAKE_HZ, np.pi),
        ),
        *(SinusoidalDrive("roll_deg", ROLL_DEG, SHAKE_HZ, 3.4), SinusoidalDrive("pan_deg", PAN_DEG, SHAKE_HZ, 0.9)),
        SinusoidalDrive("tilt_deg", PAN_DEG, 2 * SHAKE_HZ, 2.4),
    ),
)
"""Loops along x, along y and across both, while the rig nods and rolls: twice around in the lamp's exposure."""


@dataclass(frozen=True)
class Subject:
    """Sheets from back to front; none for the chart.

    `camera`: None for the bench's default. `f_number`: aperture of the lens. `slopes`: slopes of the sensor relative to
    the image, in um/mm. `motions`: vibrations of the rig; only these rotate its camera. `near_mm`: distance from the
    camera at the rail's near end; None for that of a chart.
    """

    sheets: tuple[FlatSheet, ...] = ()
    camera: SimulatedCamera | None = None
    f_number: float = NOMINAL_F_NUMBER
    motions: tuple[tuple[SinusoidalDrive, ...], ...] = ()
    slopes: tuple[float, float] = (0.0, 0.0)
    near_mm: float | None = None


def frame_camera() -> SimulatedCamera:
    """A monochrome camera whose frame is six charts wide and four high at the target s/t of the guide."""
    return SimulatedCamera(Lens(focal_length_mm=24.0), Sensor(rows=480, columns=640, cfa=None), pitch_um=11.88)


def wall(rng: np.random.Generator) -> Subject:
    """A flat wall with detail of all sizes, wider than the camera sees from the far end of the rail."""
    columns, rows = (round(size / WALL_TEXEL_MM) for size in WALL_MM)
    picture = leaves((rows, columns), rng, largest=LARGEST_MM / WALL_TEXEL_MM, per_leaf=PER_LEAF)
    return Subject((FlatSheet(picture, WALL_TEXEL_MM),), f_number=WALL_F_NUMBER, near_mm=WALL_NEAR_MM)


def depth(rng: np.random.Generator) -> Subject:
    """Three walls of leaves, one behind the other, before a rig that shakes: the nearest on the left, a round one."""
    back, middle, front = (
        FlatSheet(leaves((900, 1200), rng, largest=120.0, per_leaf=80.0), texel_mm) for texel_mm in (0.6, 0.45, 0.35)
    )
    x, y = (np.arange(n) - (n - 1) / 2 for n in (1200, 900))
    disc = np.hypot(0.45 * x - 60.0, 0.45 * y[:, None] + 40.0) < 45.0
    left = np.broadcast_to(0.35 * x < 10.0, (900, 1200))
    sheets = (
        replace(back, behind_mm=1050.0),
        replace(middle, cover=_cover(disc), behind_mm=350.0),
        replace(front, cover=_cover(left), behind_mm=-150.0),
    )
    return Subject(sheets, f_number=16.0, motions=MOTIONS)


PANEL_MM = 4000.0
"""Side of the light panel: it fills the frame from anywhere on the rail."""


def panel() -> Subject:
    """A uniform light panel."""
    return Subject((FlatSheet(np.ones((8, 8), dtype=np.float32), PANEL_MM / 8),))


EDGE_MM, EDGE_TEXEL_MM, EDGE_DEG = 40.0, 0.05, 5.0
"""Side of a dark square, whose edges are slanted, on a light sheet twice as wide; texels are smaller than pixels."""


def edge() -> Subject:
    """The slanted edges of a dark square."""
    side = EDGE_MM / EDGE_TEXEL_MM
    picture = np.full((round(2 * side), round(2 * side)), 0.8, np.float32)
    corners = cv2.boxPoints(((side, side), (side, side), EDGE_DEG))
    cv2.fillPoly(picture, [np.rint(corners).astype(np.int32)], 0.1)
    return Subject((FlatSheet(smooth(picture), EDGE_TEXEL_MM),))


TILT_F_NUMBER, TILT_SLOPES = 2.8, (9.0, -6.0)
"""f-number, and slopes in um/mm of a sensor that shall be squared to its lens: 68 um from side to side."""


def _cover(inside: npt.NDArray[np.bool_]) -> Frame:
    return smooth(inside.astype(np.float32))


SUBJECTS: Mapping[str, Callable[[np.random.Generator], Subject]] = {
    "chart": lambda rng: Subject(),
    "frame": lambda rng: Subject(camera=frame_camera()),
    "tilt": lambda rng: Subject(camera=frame_camera(), f_number=TILT_F_NUMBER, slopes=TILT_SLOPES),
    "wall": wall,
    "depth": depth,
    "panel": lambda rng: panel(),
    "edge": lambda rng: edge(),
}
"""Subjects by the names used in plans."""
