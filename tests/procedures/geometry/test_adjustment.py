from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from procedures.geometry.adjustment import AdjustmentState, adjust
from procedures.geometry.bundle import adjust_flat, first_bundle, flat_covariance
from procedures.geometry.cameras import simple_camera
from procedures.geometry.shape import rigid_shape, shape_model

from .conftest import PLAIN, SMALL
from .simulated_views import take


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
