import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from procedures.outcome import Refused
from procedures.restoration.unknown_motion.rotated_scene import kernels_of_rotated_scene, outlier_frames

SIZE = 140


def shaken(seed: int, count: int) -> np.ndarray:
    """Photographs of one scene, each blurred along its own line and shifted by some pixels, with noise."""
    rng = np.random.default_rng(seed)
    scene = 0.5 + 0.15 * np.sign(gaussian_filter(rng.standard_normal((SIZE + 30, SIZE + 30)), 5))
    frames = []
    for number in range(count):
        kernel, angle = np.zeros((21, 21)), np.pi * number / count
        for t in np.linspace(-6, 6, 60):
            kernel[round(10 + t * np.sin(angle)), round(10 + t * np.cos(angle))] += 1 / 60
        y, x = rng.integers(0, 10, 2)
        frames.append(fftconvolve(scene, kernel, mode="valid")[y : y + SIZE, x : x + SIZE])
    return np.stack(frames) + 0.01 * rng.standard_normal((count, SIZE, SIZE))


@pytest.mark.parametrize("count", [3, 9])
def test_shake_of_any_direction_is_no_outlier(count):
    assert outlier_frames(shaken(1, count)) == []


@pytest.mark.parametrize(("count", "odd"), [(3, [2]), (3, [0]), (9, [3, 7])])
def test_another_scene_is_detected_at_any_position(count, odd):
    photographs = shaken(1, count)
    photographs[odd] = shaken(2, len(odd))
    assert outlier_frames(photographs) == odd


def test_the_search_names_the_outlier_and_two_halves_have_none():
    photographs = np.concatenate([shaken(1, 2), shaken(2, 2)])
    assert outlier_frames(photographs[1:3]) == outlier_frames(photographs) == []
    photographs = np.concatenate([shaken(1, 2), shaken(2, 1)])
    with pytest.raises(Refused, match="photograph 3 of 3 shows another scene"):
        kernels_of_rotated_scene(photographs)
