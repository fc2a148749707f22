"""Photographs of the demonstration: one chart and one camera at representative positions and sizes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procedures.pattern import BLOCK, BLOCKS, Chart
from simulators.camera.camera import Lens, Photograph, SimulatedCamera, pixels_at
from simulators.camera.optics import CircularPupil, FourSpots, GaussianBlur, Optics, PixelAperture
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

WIDTH_MM = 124.0  # width of the chart: the largest on A4 with slanted edges next to it
S = 4  # samples per pixel for which the charts' sizes are chosen
PITCH_UM = 5.94
LENS = Lens(
    focal_length_mm=50.0, f_number=2.8, k1=-0.02, spherical_um=0.03, coma_um=0.06, astigmatism_um=0.08,
    field_curvature_um=0.05,
)  # fmt: skip
OPTICS = Optics((CircularPupil(LENS.f_number), PixelAperture(0.95, 0.95), FourSpots(0.8), GaussianBlur(0.3)), PITCH_UM)
"""Diffraction, photosites with gaps, an optical low-pass filter, and charge diffusion."""
ISO = 400
EXPOSURE_S = 0.02
WHITE_E_PER_S = 1.5e5


@dataclass(frozen=True)
class Staging:
    """One photograph: frame, and position, size and orientation of the chart.

    name : str, name of the files
    title : str, displayed title
    at : (x, y) the chart's centre, in fractions of the frame from the top left
    s_over_t : float, sampling ratio with four samples per pixel
    slope : (float, float) relative change of the illumination from the chart's centre to the edges of its noise region
    """

    name: str
    title: str
    at: tuple[float, float]
    s_over_t: float
    rows: int = 1000
    columns: int = 1500
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)


SETUPS = (
    Staging("1-centre-far", "Centre, from far", (0.5, 0.5), 1.0, roll_deg=1.5),
    Staging("2-centre", "Centre", (0.5, 0.5), 1.6, roll_deg=-2.0, slope=(0.02, 0.01)),
    Staging("3-edge", "Right edge, tilted", (0.82, 0.5), 1.6, yaw_deg=12.0, roll_deg=4.0, slope=(-0.04, 0.0)),
    Staging("4-corner", "Top left, tilted", (0.17, 0.23), 1.6, yaw_deg=-8.0, pitch_deg=6.0, slope=(0.05, 0.04)),
    Staging(
        "5-corner-rolled", "Bottom right, rolled", (0.85, 0.8), 1.6,
        rows=2000, columns=3000, pitch_deg=-7.0, roll_deg=-24.0, slope=(-0.03, -0.04),
    ),
)  # fmt: skip
"""The photographs of the demonstration, in order."""


def stage(setup: Staging, chart: Chart) -> tuple[SimulatedCamera, Scene]:
    """The camera and its scene."""
    sensor = Sensor(setup.rows, setup.columns, full_well_e=60000.0, gain_e_per_dn=3.78)
    camera = SimulatedCamera(LENS, sensor, PITCH_UM, OPTICS, WHITE_E_PER_S)
    placed = camera.place(
        chart, pixels=pixels_at(setup.s_over_t, S), at=setup.at, cell_mm=WIDTH_MM / (BLOCK * BLOCKS),
        yaw_deg=setup.yaw_deg, pitch_deg=setup.pitch_deg, roll_deg=setup.roll_deg,
    )  # fmt: skip
    return camera, Scene((placed,), light=camera.light_on(placed, setup.slope))


def photograph(setup: Staging, chart: Chart, rng: np.random.Generator, path: Path) -> Photograph:
    """Expose once and write the DNG."""
    camera, scene = stage(setup, chart)
    return camera.photograph(scene, rng, path, exposure_s=EXPOSURE_S, iso=ISO, bits=14)
