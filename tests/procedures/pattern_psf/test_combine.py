"""Several shots: the mean of least variance, its covariance, and shots that do not belong together."""

from types import SimpleNamespace

import numpy as np
import pytest

from procedures import Outcome, Psf, Verdict
from procedures.pattern_psf.combine import combine

K = 7
LEVEL = np.eye(K * K) - 1 / K**2


@pytest.fixture
def truth():
    x = np.arange(K) - K // 2
    h = np.exp(-(x**2 + (x[:, None] - 0.4) ** 2) / 3.0)
    return h / h.sum()


@pytest.fixture
def covariance(rng):
    """Covariance of samples of fixed sum; 1 % of the PSF's peak."""
    A = rng.normal(size=(K * K, K * K)) / K
    return 1e-6 * LEVEL @ (A @ A.T + 0.2 * np.eye(K * K)) @ LEVEL


def shot(h, covariance, verdict=Verdict.PASS, **numbers):
    found = SimpleNamespace(
        psf=Psf(h, 4, covariance), n=5000, diffraction=None, residual_std=1.0, diagnostics={"agreement": 0.9}, **numbers
    )
    return Outcome(found, verdict, "it is doubtful" if verdict is Verdict.DOUBTFUL else "", "")


def draw(rng, truth, covariance, shift=0.0):
    noise = rng.multivariate_normal(np.zeros(K * K), covariance, method="eigh").reshape(K, K)
    return truth + noise + shift * np.gradient(truth, axis=1)


def test_shots_are_combined_by_their_covariances_and_scatter(rng, truth, covariance):
    shots = [shot(draw(rng, truth, covariance), covariance) for _ in range(4)]
    found = combine(shots).value
    np.testing.assert_allclose(found.psf.h, np.mean([one.value.psf.h for one in shots], axis=0), atol=1e-9)
    # besides the scatter of the centre, which only adds
    extra = found.psf.covariance - covariance / 4
    assert np.linalg.eigvalsh(extra).min() > -1e-12
    assert found.psf.h.sum() == pytest.approx(1)
    slope = np.gradient(truth)[0]
    near, far = truth + 0.01 * (slope - slope.mean()), truth
    found = combine([shot(near, 9 * covariance), shot(far, covariance)]).value
    np.testing.assert_allclose(found.psf.h, 0.1 * near + 0.9 * far, atol=1e-9)
    shots = [shot(draw(rng, truth, covariance), covariance) for _ in range(9)]
    outcome = combine(shots)
    assert outcome.verdict is Verdict.PASS
    # 8 * 46 degrees of freedom: the deviation is sqrt(2 / 368)
    assert outcome.value.chi_square == pytest.approx(1.0, abs=4 * (2 / 368) ** 0.5)
    shots = [shot(draw(rng, truth, covariance, shift), covariance) for shift in (-0.1, 0.0, 0.1)]
    outcome = combine(shots)
    assert outcome.verdict is Verdict.PASS
    assert outcome.value.centre_px == pytest.approx(0.1 / 4, rel=0.3)


def test_a_shot_that_does_not_belong_is_refused_and_named(rng, truth, covariance):
    blurred = (truth + np.roll(truth, 1, axis=0) + np.roll(truth, -1, axis=0)) / 3
    shots = [shot(draw(rng, h, covariance), covariance) for h in (truth, truth, blurred, truth)]
    outcome = combine(shots)
    assert outcome.verdict is Verdict.REFUSED
    assert "shot 3 of 4" in outcome.reason


def test_refused_shots_are_left_out_and_a_doubt_of_most_is_kept(rng, truth, covariance):
    refused = Outcome(None, Verdict.REFUSED, "too dark", "expose longer")
    good = shot(draw(rng, truth, covariance), covariance)
    doubtful = shot(draw(rng, truth, covariance), covariance, Verdict.DOUBTFUL)
    assert combine([refused, good, good, doubtful]).verdict is Verdict.PASS
    assert combine([good, doubtful, doubtful]).reason == "it is doubtful"
    assert combine([refused]).reason == "too dark"
    assert combine([]).reason == "no shot was taken"
