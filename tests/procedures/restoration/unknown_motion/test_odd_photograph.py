from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from procedures.outcome import Refused
from procedures.restoration.unknown_motion.odd_photograph import odd_photographs
from procedures.restoration.unknown_motion.turned_scene import kernels_of_turned_scene

SIZE = 140


def shaken(seed: int, count: int) -> np.ndarray:
    """Photographs of one scene, each shaken along a line of its own and moved by some pixels, with noise."""
    rng = np.random.default_rng(seed)
    scene = 0.5 + 0.15 * np.sign(gaussian_filter(rng.standard_normal((SIZE + 30, SIZE + 30)), 5))
    found = []
    for number in range(count):
        kernel, angle = np.zeros((21, 21)), np.pi * number / count
        for t in np.linspace(-6, 6, 60):
            kernel[round(10 + t * np.sin(angle)), round(10 + t * np.cos(angle))] += 1 / 60
        y, x = rng.integers(0, 10, 2)
        found.append(fftconvolve(scene, kernel, mode="valid")[y : y + SIZE, x : x + SIZE])
    return np.stack(found) + 0.01 * rng.standard_normal((count, SIZE, SIZE))


@pytest.mark.parametrize("count", [3, 9])
def test_shake_of_any_direction_makes_none_odd(count):
    assert odd_photographs(shaken(1, count)) == []


@pytest.mark.parametrize(("count", "odd"), [(3, [2]), (3, [0]), (9, [3, 7])])
def test_another_scene_is_told_whichever_it_is(count, odd):
    photographs = shaken(1, count)
    photographs[odd] = shaken(2, len(odd))
    assert odd_photographs(photographs) == odd


def test_of_two_photographs_or_two_halves_none_is_the_odd_one():
    photographs = np.concatenate([shaken(1, 2), shaken(2, 2)])
    assert odd_photographs(photographs[1:3]) == odd_photographs(photographs) == []


def test_the_search_names_it_at_once():
    photographs = np.concatenate([shaken(1, 2), shaken(2, 1)])
    with pytest.raises(Refused, match="photograph 3 of 3 shows another scene"):
        kernels_of_turned_scene(photographs)
