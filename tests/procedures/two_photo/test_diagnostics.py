"""Diagnostics of kernels and covariances whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.psf import Psf
from procedures.two_photo.diagnostics import CLEAR, determined_to, transfer_above_one
from procedures.two_photo.inter_image import TAIL
from procedures.two_photo.near_noise import InterImageKernel

S, K = 3, 13


def point(values: dict[tuple[int, int], float] | None = None) -> np.ndarray:
    """A point of sum 1; other samples by (row, column) from the middle are taken from its peak."""
    h = np.zeros((K, K))
    for (row, column), value in (values or {}).items():
        h[K // 2 + row, K // 2 + column] = value
    h[K // 2, K // 2] = 1 - h.sum()
    return h


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("sigma", "highest"), [(0.99 * CLEAR, S / 2), (1.01 * CLEAR, 0.0)])
def test_mtf_is_determined_as_far_as_its_uncertainty_is_small(axis: int, sigma: float, highest: float) -> None:
    # K^2 samples of equal independent errors: of a point, the MTF at 0 has K times their standard deviation, and less
    # at any other frequency
    psf = Psf(point(), S, (sigma / K) ** 2 * np.eye(K * K))
    assert determined_to(psf, axis) == highest


def test_the_axes_are_determined_each_by_its_own_errors() -> None:
    # an error that shifts light along x alternates with the columns: it grows with the frequency along x
    mode = np.zeros((K, K))
    mode[K // 2, K // 2 + 1 :: 2], mode[K // 2, K // 2 :: 2] = 1, -1
    psf = Psf(point(), S, 0.02**2 * np.outer(mode, mode))
    assert determined_to(psf, 1) == S / 2
    assert 0 < determined_to(psf, 0) < S / 2


@pytest.mark.parametrize("offset", [(0, 2), (2, 0)])
def test_a_transfer_above_one_is_measured_in_its_uncertainty(offset: tuple[int, int]) -> None:
    # along one axis 1 + 2 a - 2 a cos(4 pi f), f in cycles per sample: 1 + 4 a at f = 1/4
    a, sigma = 0.05, 0.001
    k = point(dict.fromkeys((offset, (-offset[0], -offset[1])), -a))
    total, covariance = np.append(1.7 * k.ravel(), np.zeros(TAIL)), np.zeros((K * K + TAIL, K * K + TAIL))
    covariance[: K * K, : K * K] = (1.7 * sigma) ** 2 * np.eye(K * K)
    kernel = InterImageKernel(total, covariance, 0.0, 0.0, covariance, total)
    passed, excess = transfer_above_one(kernel, Psf(point(), S, np.eye(K * K)))
    assert excess == pytest.approx(4 * a, rel=1e-9)
    # K^2 independent errors, which enter with cos(2 pi f n) - 1 - 4 a, whose mean square is 1/2 + (1 + 4 a)^2
    assert passed == pytest.approx(4 * a / (K * sigma * (0.5 + (1 + 4 * a) ** 2) ** 0.5), rel=0.1)
