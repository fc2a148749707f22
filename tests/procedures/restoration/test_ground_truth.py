"""Comparison of a restoration with a sharp photograph, for scenes of known truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from procedures.outcome import BadInput, Outcome, Verdict
from procedures.raw import Plane
from procedures.restoration.ground_truth import compare_to_ground_truth
from procedures.restoration.joint.estimate import RestorationParameters, restore
from procedures.restoration.joint.schedule import Scheme

from .conftest import scene

pytestmark = pytest.mark.slow

SHAPE = (96, 112)


def planes(samples):
    return {"Y": Plane("Y", np.asarray(samples, np.float32), 1 / 65535)}


@pytest.fixture(scope="module")
def case(defocus_stacks):
    return scene(defocus_stacks, SHAPE, 40.0)


@pytest.fixture(scope="module")
def restored(case):
    return restore(list(case.z), case.stacks, RestorationParameters(scheme=Scheme.parse("4x(8+8)+1x8")))


def truth_of(case, change=lambda picture: picture):
    R = case.R
    return change(case.sharp[0])[R:-R, R:-R]


def compared(case, restored, reference):
    return compare_to_ground_truth(restored, [planes(z[0]) for z in case.z], planes(reference))


def test_error_position_and_softness_are_separated_from_the_ground_truth(case, restored):
    near = compared(case, restored, truth_of(case)).value.ground_truth
    assert near.light == pytest.approx(1, abs=0.003)
    # without the rim, where the ground truth is not compared
    assert 255 * near.error == pytest.approx(case.picture_error(restored.value.sharp, 5), rel=0.1)
    assert near.psnr_db > max(near.before_db) + 5
    far = compared(case, restored, 0.7 * truth_of(case, lambda u: np.roll(u, (2, -1), (0, 1)))).value.ground_truth
    assert far.light == pytest.approx(0.7, rel=0.005)
    assert far.error == pytest.approx(near.error, rel=0.1)
    assert np.isfinite(far.difference).mean() == pytest.approx(far.compared)
    # detail as fine as a pixel cannot be interpolated: the error is that of a softer ground truth
    truth = compared(case, restored, truth_of(case, lambda u: shift(u, (2.3, -1.4), order=5))).value.ground_truth
    middle = np.array([SHAPE[1] / 2, SHAPE[0] / 2])
    np.testing.assert_allclose(truth.matrix @ [*middle, 1] - middle, [-1.4, 2.3], atol=0.02)
    outcome = compared(case, restored, truth_of(case, lambda u: gaussian_filter(u, 1.0)))
    truth = outcome.value.ground_truth
    assert outcome.verdict is Verdict.PASS
    assert truth.softer_px == pytest.approx(1.0, abs=0.1)
    assert truth.error_as_soft < 0.5 * truth.error
    confident = replace(restored.value, sharp_std=restored.value.sharp_std / 5)
    outcome = compared(case, Outcome(confident), truth_of(case))
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "times its estimated error" in outcome.reason


def test_an_invalid_ground_truth_is_named(case, restored, defocus_stacks):
    other = scene(defocus_stacks, SHAPE, 40.0, seed=9)
    outcome = compared(case, restored, truth_of(other))
    assert (outcome.verdict, outcome.value.ground_truth) == (Verdict.DOUBTFUL, None)
    assert "another scene" in outcome.reason
    blurred = compared(case, restored, case.z[0, 0] + 0.001)
    assert "closer to photograph 1 before restoration" in blurred.reason
    with pytest.raises(BadInput, match="is photograph 2"):
        compared(case, restored, case.z[1, 0])
    with pytest.raises(BadInput, match=r"112 x 96 pixels, it has Y of 112 x 90"):
        compared(case, restored, truth_of(case)[:90])
