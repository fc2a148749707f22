from __future__ import annotations

import numpy as np
import pytest

from procedures.numerics.kernel_tail import tail_border, tail_column, tail_kernel, tail_spectrum, tail_sum

K = 9


@pytest.fixture(scope="module")
def long_tail() -> np.ndarray:
    """1/r^3 outside the support up to 60 half-widths, in units of the kernel's."""
    n = np.arange(-240, 241)
    r = np.hypot(n, n[:, None])
    inside = np.maximum(np.abs(n), np.abs(n[:, None])) <= K // 2
    tail = np.where(inside | (r > 240), 0, 1 / np.maximum(r, 1) ** 3)
    reach = slice(240 - tail_border(K), 241 + tail_border(K))
    return tail / tail[reach, reach][tail_kernel(K) > 0].sum()


def test_sum_goes_on_without_an_end(long_tail: np.ndarray) -> None:
    # beyond 240 samples lies 1/60 of what lies beyond 4, and the circle's edge is a grid's
    beyond = (tail_sum(K) - 1) * tail_border(K) / 240
    assert long_tail.sum() + beyond == pytest.approx(tail_sum(K), abs=0.01)


@pytest.mark.parametrize(("fx", "fy"), [(0.02, 0.0), (0.05, 0.03), (0.2, 0.11), (0.5, 0.5)])
def test_spectrum_is_that_of_the_long_kernel(long_tail: np.ndarray, fx: float, fy: float) -> None:
    n = np.arange(-240, 241)
    explicit = np.real(np.exp(-2j * np.pi * fy * n) @ long_tail @ np.exp(-2j * np.pi * fx * n))
    assert tail_spectrum(np.array([fx]), np.array([fy]), K)[0] == pytest.approx(explicit, abs=0.01)


def test_spectrum_starts_at_the_sum() -> None:
    assert tail_spectrum(np.zeros(1), np.zeros(1), K)[0] == pytest.approx(tail_sum(K))


def test_column_is_the_convolution(rng: np.random.Generator) -> None:
    s, border = 3, tail_border(K)
    u = rng.standard_normal((s * 9 + 1 + 2 * border, s * 12 + 1 + 2 * border)).astype(np.float32)
    seen = np.array([np.sum(tail_kernel(K)[::-1, ::-1] * part) for part in patches(u, s, 2 * border + 1)])
    rows, columns = (grid.ravel() for grid in np.mgrid[:10, :13])
    # single precision
    assert np.allclose(tail_column(u, rows, columns, s, K), seen, atol=1e-5)


def patches(u: np.ndarray, s: int, size: int) -> np.ndarray:
    """The squares of a picture around every s-th sample that has a whole one, row by row."""
    return np.lib.stride_tricks.sliding_window_view(u, (size, size))[::s, ::s].reshape(-1, size, size)
