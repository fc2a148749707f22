import numpy as np
import pytest

from procedures import Chart, Plane, estimate_psf
from procedures.field.interpolate import Interpolation, interpolate
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

from .lens import SHAPE, FieldCamera, grid, nodes

SEED = 20260314


@pytest.fixture(scope="session")
def covariance() -> np.ndarray:
    """Covariance of support and tail from one photograph of a chart 100 pixels wide, noise 0.5 % of white."""
    white_e = 5e4
    sensor = Sensor(170, 170, None, bits=16, full_well_e=1.3 * white_e, gain_e_per_dn=1.3 * white_e / 65000)
    optics = Optics.typical(f_number=2.8, pitch_um=11.88, fill=0.5, gaussian_px=0.2)
    camera = SimulatedCamera(Lens(f_number=2.8), sensor, 11.88, optics, white_e_per_s=white_e / 4 / 0.02)
    chart = Chart.from_seed()
    scene = Scene((camera.place(chart, pixels=102.4, roll_deg=3.0),))
    samples = camera.photograph(scene, np.random.default_rng(1)).plane("Y").astype(np.float32)
    return estimate_psf(Plane("Y", samples, 1 / 65535), chart).result().psf.parameter_covariance


@pytest.fixture(scope="session")
def camera() -> FieldCamera:
    return FieldCamera()


@pytest.fixture(scope="session")
def measured(camera, covariance):
    """25 nodes of the green plane."""
    return nodes(camera, grid(), covariance, np.random.default_rng(SEED))


@pytest.fixture(scope="session")
def interpolated(measured) -> Interpolation:
    """The green plane between them."""
    return interpolate("G1", SHAPE, measured)
