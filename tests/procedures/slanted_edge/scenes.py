"""Simulated edges: a bright half plane on a dark ground, through known optics, on a known sensor."""

from dataclasses import replace

import numpy as np

from procedures.raw import Plane
from simulators.camera.camera import true_mtf
from simulators.camera.optics import GaussianBlur, Optics
from simulators.camera.render import IdealImage, Region, render_region
from simulators.camera.sensor import Sensor
from simulators.world.projection import Projection
from simulators.world.scene import Illumination, Scene, Shape, Wall

FAR = 4000.0
FULL_WELL_E, WHITE, BLACK = 4095 * 0.641, 0.9, 0.1
RECIPE = Sensor(
    64, 64, None, bits=12, black=(0, 0, 0, 0), full_well_e=FULL_WELL_E, gain_e_per_dn=0.641, read_noise_e=2.5,
    prnu=0.0085,
)  # fmt: skip
"""12 bit, 0.641 electrons per step, 2.5 electrons of read noise, PRNU of 0.85 %."""


def gaussian(mtf50: float) -> Optics:
    """Optics of a Gaussian PSF with this MTF50."""
    return Optics((GaussianBlur(float(np.sqrt(np.log(2) / 2) / (np.pi * mtf50))),), 1.0)


def edge_light(
    optics: Optics,
    *,
    rows: int = 100,
    columns: int = 60,
    angle_deg: float = 5.5,
    shift: tuple[float, float] = (0.0, 0.0),
    light: Illumination | None = None,
    bend: float = 0.0,
    margin_px: int | None = None,
) -> np.ndarray:
    """Light on the pixels around an edge at an angle from the vertical, bright on its right, (rows, columns).

    `bend` displaces the edge by so many pixels times the squared position along it, in half lengths.
    """
    x, y = (columns - 1) / 2 + shift[0], (rows - 1) / 2 + shift[1]
    t = np.linspace(-8 if bend else -FAR, 8 if bend else FAR, 400 if bend else 2)
    along = t * (rows / 2 if bend else 1)
    across = x + along * np.tan(np.radians(angle_deg)) + bend * t**2 * bool(bend)
    vertices = [(float(a), float(b)) for a, b in zip(across, y + along, strict=True)]
    right = ((x + 2 * FAR, vertices[-1][1]), (x + 2 * FAR, vertices[0][1]))
    # a wall as far as the pinhole is long: a millimetre on it is a pixel
    scene = Scene(wall=Wall(1000.0, BLACK, (Shape((*vertices, *right), WHITE),)), light=light or Illumination())
    picture = IdealImage.of(scene, Projection(1000.0, (0.0, 0.0)))
    return render_region(
        picture, optics, Region(0, 0, columns, rows), {(0, 0): "Y"}, oversampling=5, margin_px=margin_px
    )


def plane(samples: np.ndarray) -> Plane:
    """A grey plane of 12 bits."""
    return Plane("Y", np.asarray(samples, dtype=np.float32), 1 / 4095)


def exposed(light: np.ndarray, serial: int, rng: np.random.Generator) -> Plane:
    """Photograph by one of many such cameras, with white at 85 % of the full well."""
    camera = replace(RECIPE, serial=serial)
    return replace(plane(camera.linear(camera.expose(light, 0.95 * FULL_WELL_E, rng))), raw=True)


def true_mtf50(optics: Optics, angle_deg: float) -> float:
    """MTF50 of the optics along the normal of an edge at an angle."""
    f = np.arange(0.0, 1.0, 0.001)
    mtf = true_mtf(optics, f, -angle_deg)
    i = int(np.flatnonzero(mtf < 0.5)[0])
    return float(f[i - 1] + (mtf[i - 1] - 0.5) / (mtf[i - 1] - mtf[i]) * 0.001)
