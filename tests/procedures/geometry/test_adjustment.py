from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from procedures.geometry import adjustment
from procedures.geometry.adjustment import AdjustmentState, NotConverged, adjust
from procedures.geometry.bundle import adjust_flat, first_bundle, flat_covariance
from procedures.geometry.cameras import simple_camera
from procedures.geometry.shape import rigid_shape, shape_model
from procedures.outcome import Refused

from .conftest import PLAIN, SMALL
from .simulated_views import Shoot, TrueCamera, take

LONG = TrueCamera((2055.0, 2055.0), (159.5, 119.5), (320, 240), (-2.1, 0.0, 0.0), (0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
"""Three views by so long a lens hardly tell its principal point from a turn and a decentred distortion."""


@pytest.fixture(scope="module")
def flat():
    """Views of a chart without any error, and pycolmap's answer."""
    taken = take(replace(SMALL, camera=PLAIN, print_mm=0.0, bend_mm=0.0), np.random.default_rng(4))
    first = first_bundle(taken.nodes, taken.views, PLAIN.size)
    camera = simple_camera("OPENCV", first.camera.focal_px, first.camera.centre, PLAIN.size)
    return taken, adjust_flat(camera, first.poses, taken.nodes, taken.views)


def test_a_perfect_chart_and_equal_points_give_what_pycolmap_gives(flat):
    taken, bundle = flat
    shape = rigid_shape(taken.nodes)
    found = adjust(
        AdjustmentState(bundle.camera, bundle.poses, np.zeros(0), 0 * taken.nodes), taken.nodes, taken.views, shape
    )
    p = len(bundle.camera.params)
    sigma = np.sqrt(np.diag(found.covariance)[:p])
    # both stop where a step changes little: a thirtieth of a standard uncertainty
    assert np.abs((found.state.camera.params - bundle.camera.params) / sigma).max() < 0.05
    theirs = flat_covariance(bundle, taken.nodes, taken.views) * 0.01**2
    # linearised at nearly the same place; ours knows beforehand that coefficients are about 1, which tells nothing here
    np.testing.assert_allclose(found.covariance[:p, :p], theirs, rtol=2e-3, atol=1e-3 * sigma.min() ** 2)


def test_the_sum_of_squares_is_that_of_noise(flat):
    taken, bundle = flat
    state = AdjustmentState(bundle.camera, bundle.poses, np.zeros(0), 0 * taken.nodes)
    found = adjust(state, taken.nodes, taken.views, rigid_shape(taken.nodes))
    count = sum(2 * len(view) for view in taken.views)
    # what is known of a distortion beforehand, a standard deviation of 1, holds it by 1e-9 of it
    assert found.freedom == pytest.approx(count - 8 - 6 * len(taken.views), abs=1e-6)
    # chi square over its freedom: standard deviation sqrt(2 / freedom), of its root half of that
    assert abs(found.scale - 1) < 3 / np.sqrt(2 * found.freedom)


def test_shape_terms_do_nothing_that_a_pose_or_scale_does(flat):
    taken, _ = flat
    shape = shape_model(taken.nodes)
    np.testing.assert_allclose(np.einsum("nas,naq->sq", shape.similarity, shape.terms), 0, atol=1e-10)
    grown = np.einsum("nas,na->s", shape.similarity, taken.nodes)
    np.testing.assert_allclose(shape.similarity @ grown, taken.nodes, atol=1e-9)  # scale is one of the seven


@pytest.fixture(scope="module")
def long_lens():
    taken = take(Shoot(LONG, 3, noise_px=0.011, width_px=130.0, tilt_deg=25.0), np.random.default_rng(1))
    first = first_bundle(taken.nodes, taken.views, LONG.size)
    camera = simple_camera("OPENCV", first.camera.focal_px, first.camera.centre, LONG.size)
    bundle = adjust_flat(camera, first.poses, taken.nodes, taken.views)
    shape = shape_model(taken.nodes)
    return taken, AdjustmentState(bundle.camera, bundle.poses, np.zeros(len(shape.prior_mm)), 0 * taken.nodes), shape


@pytest.mark.delicate
def test_a_long_curved_valley_is_followed_to_its_end(long_lens):
    taken, start, shape = long_lens
    found = adjust(start, taken.nodes, taken.views, shape)
    again = adjust(found.state, taken.nodes, taken.views, shape)
    sigma = np.sqrt(np.diag(found.covariance)[:8])
    # a thirtieth of a standard uncertainty may be left along any direction
    assert np.abs((again.state.camera.params - found.state.camera.params) / sigma).max() < 0.06


def test_an_adjustment_that_does_not_converge_blames_no_view(long_lens, monkeypatch):
    taken, start, shape = long_lens
    monkeypatch.setattr(adjustment, "minimise", partial(adjustment.minimise, limit=2))
    with pytest.raises(NotConverged, match=r"must converge; with OPENCV it did not in 2 iterations; .* was [0-9.]+e-"):
        adjust(start, taken.nodes, taken.views, shape)


def test_views_that_leave_the_camera_open_are_refused_for_that(flat):
    taken, bundle = flat
    state = AdjustmentState(bundle.camera, bundle.poses[:1], np.zeros(0), 0 * taken.nodes)
    # one view of a flat chart has 8 numbers to give, and camera and pose have 14
    camera = simple_camera("PINHOLE", bundle.camera.focal_px, bundle.camera.centre, PLAIN.size)
    with pytest.raises(Refused, match="do not determine the camera") as told:
        adjust(replace(state, camera=camera), taken.nodes, taken.views[:1], rigid_shape(taken.nodes))
    assert not isinstance(told.value, NotConverged)
