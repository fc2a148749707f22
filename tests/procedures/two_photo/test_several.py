import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures import BadParameter, Plane, Psf, TwoPhotoParameters, Verdict, estimate_psf_of_pair
from procedures.two_photo.several import estimate_psf_of_wall, joined_psf, weights

from ..pattern_psf.analytic_camera import mtf50
from .endless import CAMERAS, photographs
from .wall import samples_of

SLOW_FIXTURES = {"wall"}

SETTINGS = TwoPhotoParameters(s=3, k=13)


def plane(samples):
    return Plane("Y", np.asarray(samples, np.float32), 1 / 65535)


@pytest.fixture(scope="module")
def wall():
    """One near photograph, and far ones from 3.45 and 4.6 times its distance."""
    pairs = [
        photographs(CAMERAS["f/5.6"], zoom=zoom, size=size, noise=0.006) for zoom, size in ((3.45, 200), (4.6, 150))
    ]
    assert np.array_equal(pairs[0].near, pairs[1].near)
    return [plane(one) for one in (pairs[0].near, pairs[0].far, pairs[1].far)]


@pytest.fixture(scope="module")
def two(wall):
    """The estimate from the nearest and the farthest."""
    return estimate_psf_of_wall([wall[0], wall[2]], SETTINGS)


def test_weights_are_those_of_independent_estimates_and_two_photographs_a_pair(wall, two):
    # equal noise: the mean; four times the variance: a fifth of the weight; the variance of the mean follows
    C = np.eye(9)
    h = np.full((3, 3), 1 / 9)
    one, other = Psf(h, 2, C), Psf(h, 2, 4 * C)
    gains = weights([one, other])
    np.testing.assert_allclose(gains[0], 0.8 * np.eye(9), atol=1e-12)
    np.testing.assert_allclose(gains[0] + gains[1], np.eye(9), atol=1e-12)
    # of sum 1, so that the mean of the noise is taken out of it: 0.8 (1 - 1/9) of the variance
    joined = joined_psf([one, other], gains, "ls")
    np.testing.assert_allclose(np.diag(joined.covariance), 0.8 * (1 - 1 / 9), rtol=1e-9)
    with pytest.raises(BadParameter, match="a wall needs two photographs or more; got 1"):
        estimate_psf_of_wall([np.zeros((30, 30))])
    pair = estimate_psf_of_pair(wall[0], wall[2], SETTINGS)
    np.testing.assert_array_equal(pair.value.psf.parameters, two.value.psf.parameters)
    assert pair.value.quality.budgets == two.value.quality.budgets


@pytest.mark.parametrize("solver", ["ls", pytest.param("nnls", marks=pytest.mark.nightly)])
def test_three_distances_have_less_error_than_two(wall, two, solver):
    settings = TwoPhotoParameters(s=3, k=13, solver=solver)
    truth = samples_of(CAMERAS["f/5.6"], 3, 13)
    shuffled = [wall[2], wall[0], wall[1]]
    whole = estimate_psf_of_wall(shuffled, settings)
    pair = two if settings == SETTINGS else estimate_psf_of_wall([wall[0], wall[2]], settings)
    of_three, of_two = (np.linalg.norm(one.value.psf.h - truth) for one in (whole, pair))
    assert of_three < 0.75 * of_two
    assert whole.value.diagnostics["photographs"] == 3
    number = whole.value.quality.numbers["mtf50_horizontal"]
    assert abs(number.value - mtf50(CAMERAS["f/5.6"])) < 3 * number.uncertainty
    assert number.uncertainty < pair.value.quality.numbers["mtf50_horizontal"].uncertainty


def test_a_photograph_that_was_smoothed_does_not_pass(wall):
    smooth = plane(gaussian_filter(wall[1].samples, 0.7))
    outcome = estimate_psf_of_wall([wall[0], wall[2], smooth], SETTINGS)
    assert outcome.verdict is not Verdict.PASS
    assert "the distances disagree by" in outcome.reason
