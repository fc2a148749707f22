"""Correction of rotation and zoom between photographs of a flat scene before their kernels are estimated."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from procedures.outcome import Refused
from procedures.restoration.unknown_motion import rotated_scene
from procedures.restoration.unknown_motion.flat_scene import FreeKernels

SIZE, RIM = 200, 20
KERNELS = np.zeros((2, 9, 9))
KERNELS[0, 4, 1:8], KERNELS[1, 1:8, 4] = 1 / 7, 1 / 7


@pytest.fixture(scope="module")
def upright():
    """Blurred by a horizontal and a vertical line."""
    rng = np.random.default_rng(4)
    scene = 0.5 + 0.15 * np.sign(gaussian_filter(rng.standard_normal((SIZE + 8, SIZE + 8)), 3))
    return np.stack([fftconvolve(scene, kernel, mode="valid") for kernel in KERNELS])


def rotated(z, degrees, zoom):
    middle = (SIZE - 1) / 2, (SIZE - 1) / 2
    to = cv2.getRotationMatrix2D(middle, degrees, zoom)
    return np.stack([z[0], cv2.warpAffine(z[1], to, (SIZE, SIZE), flags=cv2.INTER_LANCZOS4, borderMode=4)])


class Search:
    """Stands for the search of kernels: returns the true ones, worse for rotated photographs."""

    def __init__(self, upright, refuses=0):
        self.upright, self.refuses, self.calls = upright, refuses, []

    def __call__(self, photographs, largest, settings, report=None):
        self.calls.append((photographs, settings.most_pixels))
        if len(self.calls) <= self.refuses:
            raise Refused(f"nothing explains them, {len(self.calls)}", "look again")
        return FreeKernels(KERNELS, float(np.std(photographs - self.upright)), 1.0)

    def deviation(self):
        """Deviation of the last photographs from the upright ones."""
        inner = (slice(None), slice(RIM, -RIM), slice(RIM, -RIM))
        return float(np.std(self.calls[-1][0][inner] - self.upright[inner]))


@pytest.fixture
def search(upright, monkeypatch):
    search = Search(upright)
    monkeypatch.setattr(rotated_scene, "kernels_of_flat_scene", search)
    return search


@pytest.mark.parametrize(("degrees", "zoom"), [(0.5, 1.0), (0.0, 1.02), (-0.7, 0.985)])
def test_rotation_and_zoom_are_corrected(search, upright, degrees, zoom):
    z = rotated(upright, degrees, zoom)
    kernels = rotated_scene.kernels_of_rotated_scene(z)
    assert len(search.calls) == 2
    # a tenth of rotation and zoom remains, and the loss by interpolation
    assert search.deviation() < 0.2 * np.std(z - upright)
    assert kernels.residual < 0.5 * np.std(z - upright)


def test_upright_photographs_are_unchanged(search, upright):
    rotated_scene.kernels_of_rotated_scene(upright)
    assert len(search.calls) == 1


def test_the_middle_is_used_where_the_frame_gives_no_kernels(search, upright):
    search.refuses = 1
    rotated_scene.kernels_of_rotated_scene(rotated(upright, 1.5, 1.0))
    assert [pixels for _, pixels in search.calls] == [120_000, rotated_scene.MIDDLE**2, 120_000]
    assert search.deviation() < 0.2 * np.std(rotated(upright, 1.5, 1.0) - upright)


@pytest.mark.parametrize("refuses", [1, 2])
def test_the_refusal_stands_without_rotation(search, upright, refuses):
    search.refuses = refuses
    with pytest.raises(Refused, match="nothing explains them, 1"):
        rotated_scene.kernels_of_rotated_scene(upright)
