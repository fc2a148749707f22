"""Kernels in the sensor's own pixels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procedures.outcome import BadParameter
from procedures.restoration.joint.kernel_sizes import BEYOND, default_max_w, fitting_ratios, size_ratios, stacks_of
from procedures.restoration.masks.blur_models import mask, pillbox


def kernel(size, seed=0):
    """A measured kernel: irregular, mostly empty."""
    random = np.random.default_rng(seed).random((size, size)) ** 8
    return random / random.sum()


@given(st.integers(3, 13), st.integers(0, 5), st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_a_measured_kernel_is_reproduced(half, room, seed):
    measured = kernel(2 * half + 1, seed)
    masked = mask(measured, half, half + room)
    assert masked[room : room + 2 * half + 1, room : room + 2 * half + 1] == pytest.approx(measured, abs=1e-12)
    assert masked.sum() == pytest.approx(1, abs=1e-12)


@given(st.floats(3.5, 9.0), st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_the_centroid_stretches_with_the_kernel(w, seed):
    # within one pixel, a cell of half a pixel and more counts at the pixel's centre: an error of a quarter pixel at
    # most
    measured = kernel(15, seed)
    x, x0 = mask(measured, w, 12).sum(axis=0) @ np.arange(-12, 13), measured.sum(axis=0) @ np.arange(-7, 8)
    assert x == pytest.approx(x0 * w / 7, abs=0.25)


def test_fine_kernels_define_range_and_ratio():
    fine = mask(pillbox(), 8.0, 9)
    # 257 samples over 16 pixels are far below a quarter of a pixel apart: the area of the disc, pixel by pixel
    assert fine[9, 9] == pytest.approx(1 / (np.pi * 8.0**2), rel=0.01)
    assert default_max_w([kernel(27), kernel(19)]) == 14
    assert default_max_w([kernel(13)]) == default_max_w([pillbox()]) == 8
    assert size_ratios([kernel(19), kernel(27)]) == (1, 26 / 18)
    assert size_ratios([pillbox(), kernel(27)]) == (1, 1)


@pytest.mark.parametrize("ratio", [0.0, -1.2, float("nan"), float("inf")])
def test_an_invalid_ratio_is_refused(ratio):
    with pytest.raises(BadParameter, match="ratio of w must be positive"):
        stacks_of([pillbox()] * 2, (1.0, ratio), 4.0, (100, 100))


def test_masks_reach_slightly_beyond_the_largest_w():
    one, two = stacks_of([pillbox()] * 2, (1.0, 1.25), 4.0, (100, 100))
    assert one.R == two.R
    assert 4 + BEYOND <= one.max_w < 4.5


@pytest.mark.slow
@pytest.mark.parametrize(("padded", "between"), [(False, 0), (True, 0), (False, 1)])
def test_ratios_of_kernels_are_those_that_fit(padded, between):
    from scipy.signal import fftconvolve

    rng = np.random.default_rng(2)
    u = np.kron(rng.random((14, 14)), np.ones((8, 8))) + 0.1 * rng.random((112, 112))
    kernels = [kernel(7, 1), *[kernel(7, 3)] * between, kernel(11, 2)]
    z = [fftconvolve(u, k, mode="same")[None, 8:-8, 8:-8] for k in kernels]
    # on the second's grid, the first kernel has the same width in pixels: then 1 is right
    padded_kernels = [np.pad(kernels[0], 2), kernels[1]] if padded else kernels
    assert fitting_ratios(z, padded_kernels, 6.0) == pytest.approx((*[1] * (1 + between), 1 if padded else 10 / 6))
