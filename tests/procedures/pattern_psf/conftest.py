from dataclasses import dataclass

import numpy as np
import pytest

from procedures import Chart, Plane
from procedures.pattern_psf.chart_finding.detection import find_chart
from procedures.pattern_psf.registration import Registration, refine_corners, register_marks
from simulators.camera.camera import Lens, Photograph, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Illumination, Scene, Wall

CHART = Chart.from_seed()
PITCH_UM = 7.52
WHITE_E = 1e9  # so many that photon noise is 3e-5: the tests add their own


@dataclass(frozen=True)
class Bench:
    """A simulated grey camera before the chart, without noise."""

    photograph: Photograph
    clean: np.ndarray

    def plane(self, sigma: float, rng: np.random.Generator) -> Plane:
        """The photograph with white Gaussian noise of a standard deviation."""
        noisy = self.clean + sigma * rng.standard_normal(self.clean.shape)
        return Plane("Y", noisy.astype(np.float32), 1 / 65535)

    def marks(self) -> tuple[np.ndarray, Registration]:
        """The marks of the photograph and the map they give."""
        samples = self.clean.astype(np.float32)
        corners = refine_corners(samples, find_chart(samples).corners, 12.0)
        return corners, register_marks(corners)


def photograph(
    *,
    pixels: float = 100.0,
    size: tuple[int, int] = (200, 210),
    yaw_deg: float = 10.0,
    roll_deg: float = 7.0,
    k1: float = 0.02,
    gaussian_px: float = 0.35,
    light: Illumination | None = None,
) -> Bench:
    """One chart before a plain wall, tilted and turned, through a lens that distorts."""
    sensor = Sensor(
        *size, None, bits=16, full_well_e=1.3 * WHITE_E, gain_e_per_dn=1.3 * WHITE_E / 65000, read_noise_e=0
    )
    optics = Optics.typical(f_number=5.6, pitch_um=PITCH_UM, gaussian_px=gaussian_px)
    camera = SimulatedCamera(Lens(k1=k1, f_number=5.6), sensor, PITCH_UM, optics, white_e_per_s=WHITE_E / 0.02)
    placed = camera.place(CHART, pixels=pixels, yaw_deg=yaw_deg, roll_deg=roll_deg)
    shot = camera.photograph(Scene((placed,), Wall(), light or Illumination()), np.random.default_rng(1))
    return Bench(shot, shot.plane("Y"))


@pytest.fixture(scope="session")
def bench() -> Bench:
    centre, radius = (105.0, 100.0), 60.0
    return photograph(light=Illumination(0.9, (0.06, -0.04), (0.02, 0.01, -0.02), centre, radius))
