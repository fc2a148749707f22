import numpy as np
import pytest
import scipy.signal

from procedures.numerics.loops import convolve_at, sums_of_groups
from procedures.numerics.transforms import sample_convolution

S, K, ROWS, COLUMNS = 3, 5, 20, 24


@pytest.fixture
def raster(rng: np.random.Generator) -> np.ndarray:
    return (rng.random((S * (ROWS - 1) + K, S * (COLUMNS - 1) + K)) - 0.5).astype(np.float32)


@pytest.fixture
def pixels() -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.mgrid[:ROWS, :COLUMNS]
    return rows.ravel().astype(np.int64), columns.ravel().astype(np.int64)


def test_matrix_is_convolution_then_sampling(raster, pixels, rng) -> None:
    h = rng.random((K, K)).astype(np.float32)
    weight = np.full(ROWS * COLUMNS, 2.0, np.float32)
    expected = scipy.signal.convolve2d(raster, h, mode="valid")[::S, ::S].ravel()
    A = sample_convolution(raster, *pixels, weight, S, K)
    np.testing.assert_allclose(A @ h.ravel(), 2 * expected, rtol=0, atol=1e-5)  # float32 sums of 25
    np.testing.assert_allclose(convolve_at(raster, *pixels, h, S), expected, rtol=0, atol=1e-5)


def test_sums_of_groups_are_those_of_their_rows(rng):
    A, group = rng.standard_normal((40, 7)).astype(np.float32), rng.integers(0, 5, 40)
    factor = rng.standard_normal(40).astype(np.float32)
    expected = [(A * factor[:, None])[group == g].sum(axis=0) for g in range(6)]
    np.testing.assert_allclose(sums_of_groups(A, group, factor, 6), expected, atol=1e-5)  # single precision
