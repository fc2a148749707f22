"""Where something moved between photographs, told from what a restoration leaves over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from procedures.outcome import Verdict
from procedures.restoration.joint.estimate import RestorationParameters, judge, restore
from procedures.restoration.joint.moved_objects import largest, moved_objects
from procedures.restoration.joint.schedule import Scheme

PATCH = (slice(30, 54), slice(50, 74))
NOISE = 0.002


@pytest.fixture(scope="module")
def seen():
    """Photographs (2, 1, 96, 112) with texture everywhere."""
    return 0.5 + 0.1 * np.random.default_rng(1).standard_normal((2, 1, 96, 112))


def left_by(seen, masks_err: float, moved: float):
    """What is left over: noise, a part of the scene everywhere, and a part of it where something moved."""
    rng = np.random.default_rng(2)
    left = NOISE * rng.standard_normal(seen.shape) + masks_err * (seen - 0.5)
    left[..., PATCH[0], PATCH[1]] += moved * (seen - 0.5)[..., PATCH[0], PATCH[1]]
    return left


def test_what_moved_is_found_where_it_is(seen):
    found = moved_objects(left_by(seen, 0.0, 0.6), seen, NOISE)
    assert found[36:48, 56:68].all()
    far = np.ones_like(found)
    # the window of 15 pixels spreads a place by 7
    far[23:61, 43:81] = False
    assert not found[far].any()
    rows, columns = largest(found)
    assert (rows.start, columns.start) == (pytest.approx(30, abs=7), pytest.approx(50, abs=7))


@pytest.mark.parametrize(("masks_err", "moved"), [(0.0, 0.0), (0.2, 0.0), (0.0, 0.05), (0.2, 0.2)])
def test_neither_noise_nor_masks_that_err_have_moved(seen, masks_err, moved):
    assert not moved_objects(left_by(seen, masks_err, moved), seen, NOISE).any()


@pytest.mark.slow
def test_a_moved_object_is_doubted_by_that_name(vibrating):
    # what stands at x 40 to 70, y 20 to 50 of photograph 1 is another scene in photograph 2
    z = vibrating.z.copy()
    z[1, :, 20:50, 40:70] = vibrating.z[1, :, 60:90, 5:35]
    outcome = restore(list(z), vibrating.stacks, RestorationParameters(scheme=Scheme(3, 4, 4, 1, 6)))
    assert outcome.verdict == Verdict.DOUBTFUL
    assert "something moved between the photographs" in outcome.reason
    found = outcome.value
    assert found.moved[30:40, 50:60].mean() > 0.5
    assert found.moved[:, 85:].mean() == 0
    assert (found.w_std[found.moved] > 1).all()
    whole = judge(replace(found, diagnostics=replace(found.diagnostics, moved=0.5)))
    assert whole.verdict == Verdict.REFUSED
    assert "something moved in 50% of the frame" in whole.reason
