import numpy as np
import pytest

from station.demo.reproduce import patterns
from station.demo.reproduce import rival_rows as rivals


def test_gradient_energy_counts_differences_of_neighbours(rng):
    h = rng.random((5, 5))
    around = np.pad(h, 1)
    down, across = (np.sum(np.diff(around, axis=axis) ** 2) for axis in (0, 1))
    L = rivals.gradient_energy(5)
    assert h.ravel() @ L @ h.ravel() == pytest.approx(down + across, rel=1e-12)


@pytest.fixture
def seen(rng):
    """A noise pattern's system, and a smooth kernel seen through it without noise."""
    A = patterns.system(patterns.bernoulli(120, 1.0, rng), 4, 7, (20, 20))
    line = np.exp(-(np.linspace(-2, 2, 7) ** 2))
    h = np.outer(line, line) / line.sum() ** 2
    return A, h, A @ h.ravel()


def test_rivals_find_the_kernel_without_noise_and_lower_its_peak_with_a_penalty(seen):
    A, h, v = seen
    assert rivals.least_squares(A, v, 7) == pytest.approx(h, abs=1e-10)
    assert rivals.joshi(A, v, 7, 1e-12) == pytest.approx(h, abs=1e-8)
    found = rivals.joshi(A, v, 7, 1.0)
    assert found.min() >= 0
    assert found.max() < 0.8 * h.max()
    truth = np.array([[1.0, 0.5], [0.5, 0.0]])
    assert rivals.psnr_db(truth + 0.1, truth) == pytest.approx(20.0)
