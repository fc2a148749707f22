"""Photographs of a flat scene that lie turned and zoomed are brought to the first before their kernels are found."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from procedures.outcome import Refused
from procedures.restoration.unknown_motion import turned_scene
from procedures.restoration.unknown_motion.flat_scene import FreeKernels

SIZE, RIM = 200, 20
KERNELS = np.zeros((2, 9, 9))
KERNELS[0, 4, 1:8], KERNELS[1, 1:8, 4] = 1 / 7, 1 / 7


@pytest.fixture(scope="module")
def upright():
    """Through a line along and a line across."""
    rng = np.random.default_rng(4)
    scene = 0.5 + 0.15 * np.sign(gaussian_filter(rng.standard_normal((SIZE + 8, SIZE + 8)), 3))
    return np.stack([fftconvolve(scene, kernel, mode="valid") for kernel in KERNELS])


def turned(z, degrees, zoom):
    middle = (SIZE - 1) / 2, (SIZE - 1) / 2
    to = cv2.getRotationMatrix2D(middle, degrees, zoom)
    return np.stack([z[0], cv2.warpAffine(z[1], to, (SIZE, SIZE), flags=cv2.INTER_LANCZOS4, borderMode=4)])


class Search:
    """Stands for the search of kernels: finds the true ones, worse in photographs that lie otherwise."""

    def __init__(self, upright, refuses=0):
        self.upright, self.refuses, self.asked = upright, refuses, []

    def __call__(self, photographs, largest, settings):
        self.asked.append((photographs, settings.most_pixels))
        if len(self.asked) <= self.refuses:
            raise Refused(f"nothing explains them, {len(self.asked)}", "look again")
        return FreeKernels(KERNELS, float(np.std(photographs - self.upright)), 1.0)

    def off(self):
        """What the last photographs differ from those that lie straight by."""
        inner = (slice(None), slice(RIM, -RIM), slice(RIM, -RIM))
        return float(np.std(self.asked[-1][0][inner] - self.upright[inner]))


@pytest.fixture
def search(upright, monkeypatch):
    made = Search(upright)
    monkeypatch.setattr(turned_scene, "kernels_of_flat_scene", made)
    return made


@pytest.mark.parametrize(("degrees", "zoom"), [(0.5, 1.0), (0.0, 1.02), (-0.7, 0.985)])
def test_what_lies_otherwise_is_brought_back(search, upright, degrees, zoom):
    z = turned(upright, degrees, zoom)
    found = turned_scene.kernels_of_turned_scene(z)
    assert len(search.asked) == 2
    # of the turn and zoom a tenth is left, and what interpolation takes
    assert search.off() < 0.2 * np.std(z - upright)
    assert found.left < 0.5 * np.std(z - upright)


def test_what_lies_straight_stays(search, upright):
    turned_scene.kernels_of_turned_scene(upright)
    assert len(search.asked) == 1


def test_where_the_frame_tells_no_kernels_its_middle_does(search, upright):
    search.refuses = 1
    turned_scene.kernels_of_turned_scene(turned(upright, 1.5, 1.0))
    assert [pixels for _, pixels in search.asked] == [120_000, turned_scene.MIDDLE**2, 120_000]
    assert search.off() < 0.2 * np.std(turned(upright, 1.5, 1.0) - upright)


@pytest.mark.parametrize("refuses", [1, 2])
def test_the_refusal_of_the_frame_stays_where_nothing_is_turned(search, upright, refuses):
    search.refuses = refuses
    with pytest.raises(Refused, match="nothing explains them, 1"):
        turned_scene.kernels_of_turned_scene(upright)
