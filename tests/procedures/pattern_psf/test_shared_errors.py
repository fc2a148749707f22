import numpy as np
import pytest

from procedures.pattern import CELLS, Chart
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found(bench) -> PatternPsf:
    outcome = estimate_psf(bench.plane(0.01, np.random.default_rng(4)), Chart.from_seed(), PatternParameters(4, 17))
    assert outcome.value is not None, outcome.reason
    return outcome.value


def together(found: PatternPsf) -> np.ndarray:
    """Covariance of the PSF's parameters and of the centre's place."""
    shared = found.shared.centre
    return np.block([[found.psf.parameter_covariance, shared], [shared.T, found.centre_covariance]])


def test_psf_and_centre_have_one_covariance_with_their_bins(found):
    middle = found.registration.to_sensor(np.full((1, 2), CELLS / 2))
    (there,) = found.shared.of_points(found.registration, middle)
    whole = together(found)
    np.testing.assert_allclose(there, whole[-2:], atol=1e-9 * np.abs(whole[-2:]).max())
    spread = np.sqrt(np.diag(whole))
    assert np.linalg.eigvalsh(whole / np.outer(spread, spread)).min() > -1e-9
    # the mark offset, and so the first moment relative to it, is a part of the centre's position
    x = np.tile((np.arange(found.psf.k) - found.psf.k // 2) / found.psf.s, found.psf.k)
    moment = np.concatenate([x, np.zeros(len(whole) - len(x))])
    shared = moment @ whole[:, -2]
    assert shared / np.sqrt((moment @ whole @ moment) * whole[-2, -2]) < -0.1
