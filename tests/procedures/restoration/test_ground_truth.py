"""What a photograph that nothing blurred says of a restoration, by scenes whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from procedures.outcome import BadInput, Outcome, Verdict
from procedures.raw import Plane
from procedures.restoration.ground_truth import held_against
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


def held(case, restored, reference):
    return held_against(restored, [planes(z[0]) for z in case.z], planes(reference))


def test_the_error_is_that_of_the_truth_however_it_lies_and_however_bright_it_is(case, restored):
    here = held(case, restored, truth_of(case)).value.ground_truth
    assert here.light == pytest.approx(1, abs=0.003)
    # without its rim, where the ground truth is not compared
    assert 255 * here.error == pytest.approx(case.picture_error(restored.value.sharp, 5), rel=0.1)
    assert here.psnr_db > max(here.before_db) + 5
    far = held(case, restored, 0.7 * truth_of(case, lambda one: np.roll(one, (2, -1), (0, 1)))).value.ground_truth
    assert far.light == pytest.approx(0.7, rel=0.005)
    assert far.error == pytest.approx(here.error, rel=0.1)
    assert np.isfinite(far.difference).mean() == pytest.approx(far.seen)


def test_its_place_is_told_to_parts_of_a_pixel(case, restored):
    # what is as fine as a pixel cannot be laid between pixels: the error is of a softer ground truth
    told = held(case, restored, truth_of(case, lambda one: shift(one, (2.3, -1.4), order=5))).value.ground_truth
    middle = np.array([SHAPE[1] / 2, SHAPE[0] / 2])
    np.testing.assert_allclose(told.matrix @ [*middle, 1] - middle, [-1.4, 2.3], atol=0.02)


def test_what_a_small_aperture_takes_from_the_ground_truth_is_told_apart(case, restored):
    outcome = held(case, restored, truth_of(case, lambda one: gaussian_filter(one, 1.0)))
    told = outcome.value.ground_truth
    assert outcome.verdict is Verdict.PASS
    assert told.softer_px == pytest.approx(1.0, abs=0.1)
    assert told.error_as_soft < 0.5 * told.error


def test_an_error_that_the_restoration_does_not_tell_makes_it_doubtful(case, restored):
    sure = replace(restored.value, sharp_std=restored.value.sharp_std / 5)
    outcome = held(case, Outcome(sure), truth_of(case))
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "times the error that it tells of itself" in outcome.reason


def test_a_ground_truth_that_is_none_is_named(case, restored, defocus_stacks):
    other = scene(defocus_stacks, SHAPE, 40.0, seed=9)
    outcome = held(case, restored, truth_of(other))
    assert (outcome.verdict, outcome.value.ground_truth) == (Verdict.DOUBTFUL, None)
    assert "another scene" in outcome.reason
    blurred = held(case, restored, case.z[0, 0] + 0.001)
    assert "nearer to photograph 1 as it came" in blurred.reason
    with pytest.raises(BadInput, match="is photograph 2"):
        held(case, restored, case.z[1, 0])
    with pytest.raises(BadInput, match=r"112 x 96 pixels, it has Y of 112 x 90"):
        held(case, restored, truth_of(case)[:90])
