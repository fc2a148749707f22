"""The files that the manual's examples name, small, in the folder in which the examples are run."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from station.demo.small_inputs import defocused, edge_light, six_charts

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


def levels(light):
    """As digital numbers of 16 bits."""
    return np.rint(65535 * np.clip(light, 0, 1)).astype(np.uint16)


def edge_levels(sigma_px=0.7):
    """An edge at 5.5 degrees, blurred by a Gaussian, as digital numbers of 16 bits."""
    return levels(edge_light(sigma_px))


def edge_of(mtf50):
    """Such an edge whose blur has this MTF50, in cycles per pixel."""
    return edge_levels(np.sqrt(np.log(2) / 2) / (np.pi * mtf50))


def render_samples():
    """All samples of a small render: a grey wall beside a white one."""
    level = np.where(np.arange(26) < 13, 0.3, 1.2)[None, :, None, None]
    return level * np.random.default_rng(5).gamma(1.0, 1.0, (24, 26, 32, 3))


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
        "frames": lambda path: (path.mkdir(), cv2.imwrite(str(path / "charts.pgm"), levels(six_charts()))),
        "edge.png": lambda path: cv2.imwrite(str(path), edge_levels()),
        "film.npz": lambda path: np.savez(path, samples=render_samples()),
        "blurred_1.pgm": lambda path: cv2.imwrite(str(path), levels(defocused(1.0))),
        "blurred_2.pgm": lambda path: cv2.imwrite(str(path), levels(defocused(1.5))),
    }

    def make(name: str) -> None:
        path = Path(name)
        if name in makers and not path.exists():
            makers[name](path)

    return make
