"""The files that the manual's examples name, small, in the folder in which the examples are run."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

from procedures.pattern import Chart
from simulators.camera.camera import SimulatedCamera
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

from ..sessions.test_index import make as make_session

SPECIFICATION = """\
[[limit]]
number = "mtf"
at = 0.25
min = 0.2
place = "centre"
"""
PROCEDURE = """\
procedure = "pattern"
planes = ["G1"]

[limits]
mtf50_horizontal = { min = 0.2 }
"""


def edge_levels(sigma_px=0.7):
    """An edge at 5.5 degrees, blurred by a Gaussian, as digital numbers of 16 bits."""
    y, x = np.mgrid[:80, :60]
    d = (x - 29.5 - np.tan(np.radians(5.5)) * (y - 39.5)) * np.cos(np.radians(5.5))
    return np.rint(65535 * (0.1 + 0.7 * ndtr(d / sigma_px))).astype(np.uint16)


def edge_of(mtf50):
    """Such an edge whose blur has this MTF50, in cycles per pixel."""
    return edge_levels(np.sqrt(np.log(2) / 2) / (np.pi * mtf50))


def six_charts():
    """A frame with a chart at six places, as digital numbers of 16 bits."""
    sensor = Sensor(280, 310, None, bits=16, full_well_e=5.2e5, gain_e_per_dn=8.0)
    camera = SimulatedCamera(sensor=sensor, pitch_um=7.5, white_e_per_s=2e7, oversampling=5)
    places = [(x, y) for y in (0.25, 0.75) for x in (0.18, 0.5, 0.82)]
    scene = Scene(tuple(camera.place(Chart.from_seed(), pixels=66, at=at, roll_deg=2.0) for at in places))
    shot = camera.photograph(scene, np.random.default_rng(4))
    return np.clip(np.rint(shot.plane("Y") * 65535), 0, 65535).astype(np.uint16)


def render_samples():
    """All samples of a small render: a grey wall beside a white one."""
    level = np.where(np.arange(26) < 13, 0.3, 1.2)[None, :, None, None]
    return level * np.random.default_rng(5).gamma(1.0, 1.0, (24, 26, 32, 3))


def defocused(sigma):
    """A textured wall through a Gaussian of this width, with noise, as digital numbers of 16 bits."""
    rng = np.random.default_rng(6)
    scene = 0.1 + 0.8 * gaussian_filter(rng.random((84, 90)), 0.8, mode="wrap")
    seen = gaussian_filter(scene, sigma)[10:-10, 10:-10] + 0.002 * rng.standard_normal((64, 70))
    return np.clip(np.rint(seen * 65535), 0, 65535).astype(np.uint16)


@pytest.fixture
def make_example_file(chart_photograph):
    """make_example_file(name): writes the file or folder that an example reads into the current folder."""
    makers = {
        "photo.dng": lambda path: chart_photograph(path, 1),
        "demo/photographs/2-centre.dng": lambda path: chart_photograph(path, 1),
        "shoot1": lambda path: chart_photograph(path / "frame0.dng", 2),
        "guided": make_session,
        "specification.toml": lambda path: path.write_text(SPECIFICATION, encoding="utf-8"),
        "lens.toml": lambda path: path.write_text(PROCEDURE, encoding="utf-8"),
        "dump.raw": lambda path: path.write_bytes(edge_levels().astype(">u2").tobytes()),
        "frames": lambda path: (path.mkdir(), cv2.imwrite(str(path / "charts.pgm"), six_charts())),
        "edge.png": lambda path: cv2.imwrite(str(path), edge_levels()),
        "film.npz": lambda path: np.savez(path, samples=render_samples()),
        "blurred_1.pgm": lambda path: cv2.imwrite(str(path), defocused(1.0)),
        "blurred_2.pgm": lambda path: cv2.imwrite(str(path), defocused(1.5)),
    }

    def make(name: str) -> None:
        path = Path(name)
        if name in makers and not path.exists():
            makers[name](path)

    return make
