from dataclasses import replace
from functools import partial

import numpy as np
import pycolmap
import pytest

from procedures.geometry import adjustment
from procedures.geometry.adjustment import AdjustmentProblem, NotConverged, adjust
from procedures.geometry.bundle import Bundle, _problem, _reconstruction, adjust_flat, first_bundle
from procedures.geometry.cameras import simple_camera
from procedures.geometry.shape import rigid_shape, shape_model
from procedures.outcome import Refused

from .conftest import PLAIN, SMALL
from .simulated_views import Shoot, TrueCamera, take

LONG = TrueCamera((2055.0, 2055.0), (159.5, 119.5), (320, 240), (-2.1, 0.0, 0.0), (0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
"""Three views through so long a lens hardly separate the principal point from a rotation and decentring."""


def opencv_bundle(taken, size) -> Bundle:
    first = first_bundle(taken.nodes, taken.views, size)
    camera = simple_camera("OPENCV", first.camera.focal_px, first.camera.centre, size)
    return adjust_flat(camera, first.poses, taken.nodes, taken.views)


def pycolmap_covariance(bundle, nodes, views) -> np.ndarray:
    """Covariance of the camera parameters for unit noise of every coordinate, marginalised over the poses."""
    scene = _reconstruction(bundle.camera, bundle.poses, nodes, views)
    config, options = _problem(scene)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, scene)
    adjuster.solve()
    choice = pycolmap.BACovarianceOptions()
    choice.params = pycolmap.BACovarianceOptionsParams.ALL
    covariance = pycolmap.estimate_ba_covariance(choice, scene, adjuster)
    return np.asarray(covariance.get_other_params_cov(scene.cameras[1].params))


@pytest.fixture(scope="module")
def flat():
    """Views of an ideal chart, pycolmap's solution, and ours."""
    taken = take(replace(SMALL, camera=PLAIN, print_mm=0.0, bend_mm=0.0), np.random.default_rng(4))
    bundle = opencv_bundle(taken, PLAIN.size)
    problem = AdjustmentProblem(taken.nodes, taken.views, rigid_shape(taken.nodes))
    return problem, bundle, adjust(problem.flat_state(bundle.camera, bundle.poses), problem)


def test_the_adjustment_of_a_flat_chart_is_pycolmaps(flat):
    problem, bundle, found = flat
    p = len(bundle.camera.params)
    sigma = np.sqrt(np.diag(found.covariance)[:p])
    # both stop where a step changes little: a thirtieth of a standard uncertainty
    assert np.abs((found.state.camera.params - bundle.camera.params) / sigma).max() < 0.05
    theirs = pycolmap_covariance(bundle, problem.nodes, problem.views) * 0.01**2
    # linearised at nearly the same state; our priors of the coefficients have no effect here
    np.testing.assert_allclose(found.covariance[:p, :p], theirs, rtol=2e-3, atol=1e-3 * sigma.min() ** 2)
    problem, _, found = flat
    count = sum(2 * len(view) for view in problem.views)
    # the prior of decentring, a standard deviation of 3e-3, contributes 1e-6
    assert found.freedom == pytest.approx(count - 8 - 6 * len(problem.views), abs=1e-5)
    # chi square over its freedom: standard deviation sqrt(2 / freedom), of its root half of that
    assert abs(found.scale - 1) < 3 / np.sqrt(2 * found.freedom)
    # node errors of 1e-5 mm are a hundredth of the noise; their seven movements of the whole chart are excluded
    # already. Terms of 1e-6 mm are known by their priors alone
    problem, bundle, found = flat
    nodes = replace(problem.shape, node_mm=np.full(3, 1e-5))
    curved = shape_model(problem.nodes, node_mm=0.0)
    for shape in (nodes, replace(curved, prior_mm=np.full_like(curved.prior_mm, 1e-6))):
        tight = replace(problem, shape=shape)
        again = adjust(tight.flat_state(bundle.camera, bundle.poses), tight)
        assert again.freedom == pytest.approx(found.freedom, abs=0.5)


def test_shape_terms_exclude_poses_and_scale(taken):
    shape = shape_model(taken.nodes)
    np.testing.assert_allclose(np.einsum("nas,naq->sq", shape.similarity, shape.terms), 0, atol=1e-10)
    grown = np.einsum("nas,na->s", shape.similarity, taken.nodes)
    np.testing.assert_allclose(shape.similarity @ grown, taken.nodes, atol=1e-9)  # scale is one of the seven


@pytest.fixture(scope="module")
def long_lens():
    taken = take(Shoot(LONG, 3, noise_px=0.011, width_px=130.0, tilt_deg=25.0), np.random.default_rng(1))
    bundle = opencv_bundle(taken, LONG.size)
    problem = AdjustmentProblem(taken.nodes, taken.views, shape_model(taken.nodes))
    return problem.flat_state(bundle.camera, bundle.poses), problem


@pytest.mark.delicate
def test_a_long_curved_valley_is_followed_to_its_end(long_lens):
    start, problem = long_lens
    found = adjust(start, problem)
    again = adjust(found.state, problem)
    sigma = np.sqrt(np.diag(found.covariance)[:8])
    # a thirtieth of a standard uncertainty may be left along any direction
    assert np.abs((again.state.camera.params - found.state.camera.params) / sigma).max() < 0.06


def test_an_adjustment_that_does_not_converge_blames_no_view(long_lens, monkeypatch):
    monkeypatch.setattr(adjustment, "minimise", partial(adjustment.minimise, limit=2))
    with pytest.raises(NotConverged, match=r"must converge; with OPENCV it did not in 2 iterations; .* was [0-9.]+e-"):
        adjust(*long_lens)


def test_views_that_do_not_determine_the_camera_are_refused(flat):
    problem, bundle, _ = flat
    # one view of a flat chart determines 8 numbers; camera and pose have 14
    camera = simple_camera("PINHOLE", bundle.camera.focal_px, bundle.camera.centre, PLAIN.size)
    with pytest.raises(Refused, match="do not determine the camera") as caught:
        adjust(problem.flat_state(camera, bundle.poses[:1]), replace(problem, views=problem.views[:1]))
    assert not isinstance(caught.value, NotConverged)
