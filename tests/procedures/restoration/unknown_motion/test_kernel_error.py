"""Difference of pictures from two searches' kernels, where it is known: for sinusoidal waves, which filters only
scale."""

import numpy as np
import pytest

from procedures.restoration.unknown_motion.kernel_error import picture_change

WEIGHT = 0.02
ROWS, COLUMNS = 96, 120


def kernels(row):
    masks = np.zeros((2, 5, 5))
    masks[:, 2] = row
    return masks


def test_the_error_of_a_kernel_is_the_difference_of_two_filters_without_their_shift():
    wave = 0.5 + 0.2 * np.cos(np.pi * 12 * (np.arange(COLUMNS) / (COLUMNS - 1)))[None, None] * np.ones((1, ROWS, 1))
    f = 6 / (COLUMNS - 1)
    G, stiff = 0.5 + 0.5 * np.cos(2 * np.pi * f), WEIGHT * (2 - 2 * np.cos(2 * np.pi * f))
    expected = 0.2 * abs(2 * G / (2 * G**2 + stiff) - 2 / (2 + stiff))
    change = picture_change(wave, kernels([0, 0, 1, 0, 0]), kernels([0, 0.25, 0.5, 0.25, 0]), WEIGHT)
    assert change.shape == (ROWS, COLUMNS)
    # a window of five pixels is a quarter of the wave: its local mean oscillates, the mean over the frame does not
    assert np.sqrt(np.mean(change**2)) == pytest.approx(expected / 2**0.5, rel=0.03)
    blur = kernels([0, 0.25, 0.5, 0.25, 0])
    assert picture_change(wave, blur, blur, WEIGHT).max() < 1e-9
    assert picture_change(wave, blur, np.roll(blur, (1, -1), (1, 2)), WEIGHT).max() < 1e-9
