import numpy as np
import pytest

from procedures.pattern_psf.correspondences import BINS, bin_centres, informed, normal_equations
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf

from .conftest import CHART, photograph

SLOW_FIXTURES = {"bench"}


@pytest.fixture(scope="module")
def bench():
    return photograph(pixels=130.0, size=(230, 240), yaw_deg=20.0, k1=0.03)


def seen(bench, seed):
    found = estimate_psf(bench.plane(0.008, np.random.default_rng(seed)), CHART, PatternParameters(3, 13, chosen=True))
    assert found.value is not None
    return found.value.correspondences


def test_bins_are_seen_where_they_are_with_the_scatter_that_is_stated(bench):
    pulls = []
    for seed in range(2):
        one = seen(bench, seed)
        error = one.points - bench.photograph.true_points("Y", one.cells)
        assert len(one.index) > 0.97 * BINS**2
        # what all bins share is the PSF's centre, which a pose takes: known to some thousandths of a pixel
        assert np.linalg.norm(error.mean(axis=0)) < 0.005
        root = np.linalg.cholesky(one.covariance)
        pulls.append(np.linalg.solve(root, (error - error.mean(axis=0))[..., None])[..., 0])
    spread = np.concatenate(pulls).std(axis=0)
    # 1150 bins: a standard deviation is known to 2 %, and the slopes of a noisy PSF add as much
    np.testing.assert_allclose(spread, 1, atol=0.08)


def test_bins_err_independently(bench):
    one = seen(bench, 5)
    left = one.points - bench.photograph.true_points("Y", one.cells)
    left = left - left.mean(axis=0)
    grid = np.full((BINS * BINS, 2), np.nan)
    grid[one.index] = left
    grid = grid.reshape(BINS, BINS, 2)
    neighbours = np.nanmean(grid[:, 1:] * grid[:, :-1]) / np.nanmean(grid**2)
    assert abs(neighbours) < 4 / np.sqrt(2 * BINS * (BINS - 1))


def test_bins_are_summed_row_by_row_without_those_that_tell_little(rng):
    slopes, residual, which = rng.standard_normal((50, 2)), rng.standard_normal(50), rng.integers(0, 3, 50)
    JJ, Jr = normal_equations(slopes, residual, which, 4)
    part = which == 2
    np.testing.assert_allclose(JJ[2], slopes[part].T @ slopes[part])
    np.testing.assert_allclose(Jr[2], slopes[part].T @ residual[part])
    assert not JJ[3].any()
    JJ = np.stack([np.eye(2) * one for one in (1.0, 0.9, 1.1, 0.1, 0.0)])
    np.testing.assert_array_equal(informed(JJ), [0, 1, 2])
    centres = bin_centres()
    np.testing.assert_allclose(centres[0], 256 / 48)
    np.testing.assert_allclose(centres[1] - centres[0], [256 / 24, 0])
    np.testing.assert_allclose(centres[BINS] - centres[0], [0, 256 / 24])
