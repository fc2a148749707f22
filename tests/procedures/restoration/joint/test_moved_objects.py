"""Motion between photographs, detected from the residual of a restoration."""

from dataclasses import replace

import numpy as np
import pytest

from procedures import Scheme, Verdict
from procedures.restoration.joint.estimate import RestorationParameters, judge, restore
from procedures.restoration.joint.moved_objects import largest, moved_objects

PATCH = (slice(30, 54), slice(50, 74))
NOISE = 0.002


@pytest.fixture(scope="module")
def photographs():
    """Photographs (2, 1, 96, 112) with texture everywhere."""
    return 0.5 + 0.1 * np.random.default_rng(1).standard_normal((2, 1, 96, 112))


def residual_of(photographs, masks_err: float, moved: float):
    """Residual: noise, a fraction of the scene everywhere, and a larger one where something moved."""
    rng = np.random.default_rng(2)
    residual = NOISE * rng.standard_normal(photographs.shape) + masks_err * (photographs - 0.5)
    residual[..., PATCH[0], PATCH[1]] += moved * (photographs - 0.5)[..., PATCH[0], PATCH[1]]
    return residual


def test_motion_is_located(photographs):
    result = moved_objects(residual_of(photographs, 0.0, 0.6), photographs, NOISE)
    assert result[36:48, 56:68].all()
    far = np.ones_like(result)
    # the window of 15 pixels spreads a place by 7
    far[23:61, 43:81] = False
    assert not result[far].any()
    rows, columns = largest(result)
    assert (rows.start, columns.start) == (pytest.approx(30, abs=7), pytest.approx(50, abs=7))


@pytest.mark.parametrize(("masks_err", "moved"), [(0.0, 0.0), (0.2, 0.0), (0.0, 0.05), (0.2, 0.2)])
def test_noise_and_inaccurate_masks_are_no_motion(photographs, masks_err, moved):
    assert not moved_objects(residual_of(photographs, masks_err, moved), photographs, NOISE).any()


def test_a_residual_of_the_outermost_column_is_no_motion(photographs):
    residual = 5 * residual_of(photographs, 0.0, 0.0)
    residual[..., 0] = 0.07
    assert not moved_objects(residual, photographs, NOISE).any()
    residual[..., :8] = residual[..., :1]
    assert moved_objects(residual, photographs, NOISE).any()


@pytest.mark.slow
def test_a_moved_object_is_named_as_the_reason(vibrating):
    # the part at x 40 to 70, y 20 to 50 of photograph 1 is from another scene in photograph 2
    z = vibrating.z.copy()
    z[1, :, 20:50, 40:70] = vibrating.z[1, :, 60:90, 5:35]
    outcome = restore(list(z), vibrating.stacks, RestorationParameters(scheme=Scheme(3, 4, 4, 1, 6)))
    assert outcome.verdict == Verdict.DOUBTFUL
    assert "something moved between the photographs" in outcome.reason
    result = outcome.value
    assert result.moved[30:40, 50:60].mean() > 0.5
    assert result.moved[:, 85:].mean() == 0
    assert (result.w_std[result.moved] > 1).all()
    whole = judge(replace(result, diagnostics=replace(result.diagnostics, moved=0.5)))
    assert whole.verdict == Verdict.REFUSED
    assert "something moved in 50% of the frame" in whole.reason
