"""Diagnostics of kernels and covariances whose answers are known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from procedures.psf import Psf
from procedures.two_photo.diagnostics import CLEAR, TILES, determined_to, local_shifts, relief, transfer_above_one
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


NOISE, SIDE = 0.01, 20


def fitted(rng: np.random.Generator, shifts: np.ndarray, diagonal: slice = slice(0)) -> Any:
    """A fit of TILES x TILES squares; the residual is noise and the shift (n, 2) of each square or of each sample.

    In `diagonal` squares all gradients have one direction, in which alone a shift can be seen.
    """
    rows, columns = (grid.ravel() for grid in np.indices((TILES * SIDE, TILES * SIDE)))
    tile = rows // SIDE * TILES + columns // SIDE
    slopes = rng.standard_normal((len(tile), 2))
    along = np.isin(tile, np.arange(TILES**2)[diagonal])
    slopes[along, 1] = slopes[along, 0] * (1 + 1e-5 * rng.standard_normal(np.count_nonzero(along)))
    moved = shifts[tile] if len(shifts) == TILES**2 else shifts
    residual = np.sum(slopes * moved, axis=1) + NOISE * rng.standard_normal(len(tile))
    shape = (TILES * SIDE, TILES * SIDE)
    return SimpleNamespace(
        samples=SimpleNamespace(rows=rows, columns=columns), near=SimpleNamespace(shape=shape), slopes=slopes,
        residual=residual, variance=NOISE**2, prediction=rng.random(len(tile)),
    )  # fmt: skip


def test_shifts_of_parts_are_measured_with_their_noise_and_relief(rng):
    shifts = 0.03 * rng.standard_normal((TILES**2, 2))
    shift, significance = local_shifts(fitted(rng, shifts, slice(3)))
    # a square's shift is known to NOISE / SIDE, a sixtieth of it
    assert shift == pytest.approx(np.sqrt(np.mean(np.sum(shifts[3:] ** 2, axis=1))), rel=0.03)
    # chi^2 of 122 degrees is SIDE^2 times the squared shifts in units of the noise
    chi2 = SIDE**2 * np.sum(shifts[3:] ** 2) / NOISE**2
    assert significance == pytest.approx(chi2 / np.sqrt(2 * 122), rel=0.1)
    found = [local_shifts(fitted(rng, np.zeros((TILES**2, 2)))) for _ in range(20)]
    shift, significance = np.transpose(found)
    # the variance of 128 normal numbers of NOISE / SIDE is known to 12 %
    assert shift.max() < 1.2 * NOISE / SIDE
    assert abs(significance.mean()) < 3 / 20**0.5
    assert significance.std() == pytest.approx(1, abs=3 / 40**0.5)
    random = 0.02 * rng.standard_normal((TILES**2 * SIDE**2, 2))
    # along either axis; 25 600 squares whose variance is known to a few per cent
    assert relief(fitted(rng, random)) == pytest.approx(0.02 * 2**0.5, rel=0.05)
    assert relief(fitted(rng, 0 * random)) < 0.2 * NOISE
