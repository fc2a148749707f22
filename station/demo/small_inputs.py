"""Small inputs of procedures: what the manual's pictures are drawn from, and the tests measure."""

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

from procedures.pattern import Chart
from procedures.tilt.estimate import Tilt
from procedures.tilt.plane import Screws, fit_plane, turns_for
from simulators.camera.camera import SimulatedCamera
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

Light = npt.NDArray[np.floating[Any]]


def edge_light(sigma_px: float = 0.7) -> Light:
    """An edge at 5.5 degrees, blurred by a Gaussian; 1 is white."""
    y, x = np.mgrid[:80, :60]
    away = (x - 29.5 - np.tan(np.radians(5.5)) * (y - 39.5)) * np.cos(np.radians(5.5))
    return np.asarray(0.1 + 0.7 * ndtr(away / sigma_px))


def six_charts() -> Light:
    """A frame with a chart at six places."""
    sensor = Sensor(280, 310, None, bits=16, full_well_e=5.2e5, gain_e_per_dn=8.0)
    camera = SimulatedCamera(sensor=sensor, pitch_um=7.5, white_e_per_s=2e7, oversampling=5)
    places = [(x, y) for y in (0.25, 0.75) for x in (0.18, 0.5, 0.82)]
    scene = Scene(tuple(camera.place(Chart.from_seed(), pixels=66, at=at, roll_deg=2.0) for at in places))
    return camera.photograph(scene, np.random.default_rng(4)).plane("Y")


def defocused(sigma_px: float) -> Light:
    """A textured wall through a Gaussian of this width, with noise."""
    rng = np.random.default_rng(6)
    scene = 0.1 + 0.8 * gaussian_filter(rng.random((84, 90)), 0.8, mode="wrap")
    return np.asarray(gaussian_filter(scene, sigma_px)[10:-10, 10:-10] + 0.002 * rng.standard_normal((64, 70)))


def tilted_sensor(noise_um: float = 0.0) -> Tilt:
    """Best focus at nine places behind a sensor of known slopes, with noise, and the screws that lay it level."""
    places = np.array([(x, y) for y in (-10.0, 0.0, 10.0) for x in (-15.0, 0.0, 15.0)])
    x, y = places.T
    noise = noise_um * np.random.default_rng(8).standard_normal(9)
    plane = fit_plane(places, 2 + 1.5 * x - 0.5 * y + 0.02 * x**2 + noise, np.eye(9), (36.0, 24.0))
    screws = Screws(first_deg=30.0)
    return Tilt(plane, np.zeros(9), screws, turns_for(plane, screws, with_focus=True), True)
