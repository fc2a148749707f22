from __future__ import annotations

from dataclasses import replace

import numpy as np

from procedures.geometry.adjustment import adjust
from procedures.geometry.response import camera_response
from procedures.geometry.shape import shape_model


def test_the_camera_moves_with_its_points_as_the_response_says(geometry, taken):
    rng, views = np.random.default_rng(21), [one.view for one in geometry.views]
    shape = replace(shape_model(taken.nodes), node_mm=np.array(geometry.shape.node_mm))
    at_rest = adjust(geometry.adjustment.state, taken.nodes, views, shape)
    response = camera_response(at_rest, taken.nodes, views, shape)
    moves = [0.03 * rng.standard_normal(view.points.shape) for view in views]  # three times the points' own noise
    moved = [replace(view, points=view.points + move) for view, move in zip(views, moves, strict=True)]
    change = adjust(at_rest.state, taken.nodes, moved, shape).state.camera.params - at_rest.state.camera.params
    expected = sum(np.einsum("pna,na->p", r, move) for r, move in zip(response, moves, strict=True))
    spread = np.sqrt(np.diag(at_rest.covariance)[: len(change)])
    assert np.abs(expected / spread).max() > 2  # there is something to see
    # either adjustment stops within a thirtieth of an uncertainty of its end; the model bends a little over three
    np.testing.assert_allclose(change / spread, expected / spread, atol=0.15)


def test_the_response_to_the_points_own_noise_is_the_camera_s_covariance(geometry, taken):
    views, found = [one.view for one in geometry.views], geometry.adjustment
    shape = replace(shape_model(taken.nodes), node_mm=np.array(geometry.shape.node_mm))
    carried = np.zeros((len(geometry.camera.params),) * 2)
    for view, response in zip(views, camera_response(found, taken.nodes, views, shape), strict=True):
        carried += np.einsum("pna,nab,qnb->pq", response, view.covariance, response)
    whole = found.covariance[: len(carried), : len(carried)]
    # the rest of the covariance is what print and priors leave: never less than nothing
    left = np.linalg.eigvalsh(whole - carried)
    assert left.min() > -1e-9 * np.linalg.eigvalsh(whole).max()
    assert np.diag(carried / whole).max() <= 1
    assert np.diag(carried / whole).min() > 0.02
