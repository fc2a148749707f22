"""Random photographs for trials of detection and estimation."""

from dataclasses import dataclass

import numpy as np

from procedures.pattern import Chart
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Illumination, Scene, Wall
from tests.simulators.clutter import random_clutter


@dataclass(frozen=True)
class Trials:
    """Ranges of the parameters of random photographs.

    Attributes
    ----------
    rows, columns : int
        Size of the grey frames.
    pixels : (float, float)
        Width of the noise region, minimum and maximum.
    tilt_deg : float
        Largest angle between the chart's normal and the axis.
    noise : (float, float)
        Standard deviation of the white paper, relative to the chart's contrast, minimum and maximum.
    gradient : float
        Largest relative change of the light between the chart's centre and its rim (or the middle of the frame's half).
    clutter : bool
        Whether there are objects around the chart.
    """

    rows: int = 480
    columns: int = 640
    pixels: tuple[float, float] = (60.0, 300.0)
    tilt_deg: float = 25.0
    noise: tuple[float, float] = (0.002, 0.05)
    gradient: float = 0.2
    distortion: float = 0.03
    clutter: bool = True
    pitch_um: float = 7.52


def random_camera(rng: np.random.Generator, trials: Trials) -> SimulatedCamera:
    """A camera with a grey sensor and random noise on white."""
    noise = float(np.exp(rng.uniform(*np.log(trials.noise))))
    lens = Lens(k1=rng.uniform(-1, 1) * trials.distortion, f_number=float(rng.choice([4.0, 5.6, 8.0, 11.0])))
    # on paper of 0.9, with a contrast of 0.86: sd / contrast = sqrt(0.9 white_e) / (0.86 white_e)
    white_e = 0.9 / (0.86 * noise) ** 2
    sensor = Sensor(
        trials.rows, trials.columns, None, bits=16, full_well_e=1.3 * white_e, gain_e_per_dn=1.3 * white_e / 65000,
        read_noise_e=0.0,
    )  # fmt: skip
    optics = Optics.typical(f_number=lens.f_number, pitch_um=trials.pitch_um, gaussian_px=rng.uniform(0.1, 0.5))
    aperture = (5.6 / lens.f_number) ** 2
    # 5 fine samples have errors of at most 2e-3 of full light at f/4, 2e-4 root mean square: below the noise
    return SimulatedCamera(
        lens, sensor, trials.pitch_um, optics, white_e_per_s=white_e / aperture / 0.02, oversampling=5
    )


def random_scene(rng: np.random.Generator, camera: SimulatedCamera, chart: Chart | None, trials: Trials) -> Scene:
    """A whole chart at a random position and orientation; only clutter where `chart` is None."""
    wall_mm = 6000.0
    width, height = (n * trials.pitch_um / 1000 * wall_mm / 50 for n in (trials.columns, trials.rows))
    shapes = random_clutter(rng, width, height) if trials.clutter or chart is None else ()
    wall = Wall(wall_mm, rng.uniform(0.1, 0.8), shapes)
    if chart is None:
        return Scene((), wall, Illumination())
    largest = 0.66 * min(trials.rows, trials.columns)
    pixels = rng.uniform(trials.pixels[0], min(trials.pixels[1], largest))
    reach = pixels * 1.42 / 2 * 1.38  # half the sheet's diagonal
    at = tuple(rng.uniform(min(reach / n, 0.5), max(1 - reach / n, 0.5)) for n in (trials.columns, trials.rows))
    tilt, toward = rng.uniform(0, trials.tilt_deg), rng.uniform(0, 2 * np.pi)
    placed = camera.place(
        chart, pixels=pixels, at=(at[0], at[1]), cell_mm=300 / 320,
        yaw_deg=tilt * np.cos(toward), pitch_deg=tilt * np.sin(toward), roll_deg=rng.uniform(0, 360),
    )  # fmt: skip
    slope, bend = rng.uniform(-1, 1, 2) * trials.gradient / 1.5, rng.uniform(-1, 1, 3) * trials.gradient / 6
    centre = at[0] * trials.columns, at[1] * trials.rows
    light = Illumination(
        1.0, (slope[0], slope[1]), (bend[0], bend[1], bend[2]), centre, max(pixels, trials.columns / 2) / 2
    )
    return Scene((placed,), wall, light)
