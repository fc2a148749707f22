"""Clipped samples accumulate at one value; uniform areas with noise, quantised or not, do not."""

import numpy as np
import pytest

from procedures.clipping import find_clipping

STEP = 1 / 255


def plain(rng: np.random.Generator, noise_steps: float, level: float = 0.6) -> np.ndarray:
    return level + noise_steps * STEP * rng.standard_normal(4000)


def rounded(samples: np.ndarray) -> np.ndarray:
    return np.rint(samples / STEP) * STEP


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.2, 0.4, 1.0, 5.0])
@pytest.mark.parametrize("level", [0.6, 0.6 + 0.3 * STEP, 0.6 + 0.5 * STEP])
def test_plains_of_any_noise_and_level_are_whole(rng: np.random.Generator, noise: float, level: float) -> None:
    # light is never less noisy where there is more of it: the dark plain has at most as much noise, the bright one
    # at most fifteen times as much
    samples = rounded(plain(rng, noise, level))
    found = find_clipping(samples, STEP, dark_noise=noise * STEP, bright_noise=1.5 * noise * STEP)
    assert (found.black, found.white) == (0, 0)


@pytest.mark.parametrize("at", [0.0, -1.0, -5.0])
def test_a_plain_cut_off_is_counted(rng: np.random.Generator, at: float) -> None:
    # cut at its mean, one and five standard deviations under it: half, 84 % and all of it
    whole = plain(rng, 4.0)
    share = np.mean(whole >= 0.6 + at * 4 * STEP)
    found = find_clipping(np.minimum(whole, 0.6 + at * 4 * STEP), STEP, dark_noise=2 * STEP)
    assert found.white == pytest.approx(share, abs=0.06)  # a tenth of a standard deviation is one step's half
    mirrored = find_clipping(np.maximum(-whole, -0.6 - at * 4 * STEP), STEP, bright_noise=2.5 * STEP)
    assert mirrored.black == pytest.approx(share, abs=0.06)


def test_few_bits_stuck_pixels_and_chance_make_no_pile(rng):
    samples = rounded(plain(rng, 0.5))
    assert find_clipping(samples, 1 / 65535, dark_noise=0.2 * STEP).white == 0
    cut = np.minimum(samples, rounded(np.array(0.6)) - 2 * STEP)
    assert find_clipping(np.append(cut, rounded(plain(rng, 0.5, 0.2))), 1 / 65535, dark_noise=0.5 * STEP).white > 0.4
    assert find_clipping(np.array([0.1, 0.2, 0.9985, 1.0])).white == 0.5
    samples = np.minimum(plain(rng, 4.0), 0.59)
    samples[:2] = 0.97
    assert find_clipping(samples, STEP, dark_noise=STEP).white > 0.6
    assert find_clipping(np.array([])).white == 0
    # the white blocks of a small chart have 192 samples: two of them are often the largest
    found = [
        find_clipping(rounded(plain(rng, 5.0)[:192]), STEP, dark_noise=4 * STEP, bright_noise=5 * STEP)
        for _ in range(200)
    ]
    assert {(one.black, one.white) for one in found} == {(0.0, 0.0)}
