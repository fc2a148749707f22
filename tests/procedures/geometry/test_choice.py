"""The choice of a model and of a pose; places in a photograph and on its chart."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from procedures.geometry.cameras import parameter_names, simple_camera
from procedures.geometry.chart_bins.bin_kernels import RenderModel, cells_along
from procedures.geometry.choice import LEAST_VIEWS, choose_model, fit_pose
from procedures.geometry.next_view import chart_at
from procedures.geometry.views import ChartView, Pose, chart_nodes
from procedures.numerics.warps import CubicWarp


def test_a_chart_behind_the_camera_leaves_an_infinite_residual():
    camera, nodes = simple_camera("OPENCV", (2000.0, 2000.0), (319.5, 239.5), (640, 480)), chart_nodes(0.3)
    points = camera.project(Pose(np.eye(3), np.array([0.0, 0.0, 1700.0])).apply(nodes))
    view = ChartView("view", np.arange(len(nodes)), points, np.tile(1e-4 * np.eye(2), (len(nodes), 1, 1)))
    residual = fit_pose(camera, Pose(np.eye(3), np.array([0.0, 0.0, -1700.0])), nodes, view)[1]
    assert not np.isfinite(residual).any()


@pytest.mark.parametrize(
    ("models", "order"),
    [
        (("SIMPLE_RADIAL", "OPENCV", "FULL_OPENCV"), ["OPENCV", "SIMPLE_RADIAL", "FULL_OPENCV"]),
        (("SIMPLE_RADIAL", "FULL_OPENCV"), ["SIMPLE_RADIAL", "FULL_OPENCV"]),
    ],
)
def test_too_few_views_compare_no_models_and_take_the_usual_one(models, order):
    trials = choose_model(models, None, SimpleNamespace(views=[None] * (LEAST_VIEWS - 1)))
    assert [one.model for one in trials] == order
    assert trials[0].parameters == len(parameter_names(order[0]))
    assert all(np.isnan(one.left_over) for one in trials)


def test_a_place_in_the_photograph_is_a_place_on_the_chart():
    # through a displacement of all cubics and a homography, in a picture reduced by three
    rng = np.random.default_rng(2)
    H = np.array([[0.4, 0.02, 3], [-0.03, 0.5, 2], [1e-4, -2e-4, 1]])
    warp = CubicWarp(H, np.array([20.0, 15.0]), 30.0, 0.3 * rng.standard_normal((2, 9)))
    look = RenderModel(
        np.zeros((4, 4), np.float32), np.zeros((4, 4)), warp.H, warp.centre, warp.radius, warp.displacement, 3, 0.0,
        1.0, 3, 0.5, np.ones(3),
    )  # fmt: skip
    cells = np.empty((2, 7))
    cells_along(look, 10.0, 31.0, 4.0, cells)
    places = np.column_stack([10.0 + 4.0 * np.arange(7), np.full(7, 31.0)])
    # the middle of a reduced pixel of three is that of its second one
    np.testing.assert_allclose(cells.T, warp.forward((places - 1) / 3), rtol=1e-9)


@pytest.mark.parametrize("at", [(0.0, 0.0), (0.25, 0.75), (1.0, 1.0)])
def test_a_chart_hangs_where_it_is_wanted(at):
    camera = simple_camera("OPENCV", (2000.0, 2000.0), (310.0, 239.5), (640, 480))
    pose = chart_at(camera, at, 30.0, -20.0, 1500.0)
    np.testing.assert_allclose(camera.project(pose.t[None])[0], [at[0] * 639, at[1] * 479], atol=1e-6)
    assert np.linalg.norm(pose.t) == pytest.approx(1500)
    # turned about its upright axis first, then about its own horizontal one
    turn = np.radians([30, -20])
    expected = [np.sin(turn[0]) * np.cos(turn[1]), -np.sin(turn[1]), np.cos(turn[0]) * np.cos(turn[1])]
    np.testing.assert_allclose(pose.R[:, 2], expected, atol=1e-12)
