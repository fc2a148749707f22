from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from procedures.geometry.adjustment import AdjustmentProblem
from procedures.geometry.cameras import simple_camera
from procedures.geometry.estimate import SMALL_SHARE
from procedures.geometry.next_view import (
    COVER,
    STEEPEST_DEG,
    NextView,
    chart_at,
    corner_share,
    next_view_words,
    next_views,
    planned_view,
)
from procedures.geometry.reference import first_state, fit_formula
from procedures.geometry.shape import shape_model
from procedures.geometry.views import ChartView, chart_nodes

from .conftest import PLAIN, SMALL
from .simulated_views import take


@pytest.fixture(scope="module")
def few():
    """Five views near the middle of the frame, and their adjustment."""
    taken = take(replace(SMALL, camera=PLAIN, print_mm=0.0, width_px=1200.0), np.random.default_rng(3))
    views = [view for view, pose in zip(taken.views, taken.poses, strict=True) if abs(pose.t[0]) < 0.2 * pose.t[2]][:5]
    problem = AdjustmentProblem(taken.nodes, views, shape_model(taken.nodes, 0.001))
    return taken, fit_formula("OPENCV", first_state(problem, PLAIN.size), problem)


@pytest.mark.slow
def test_the_proposed_view_reduces_the_uncertainty_as_predicted(few):
    taken, fit = few
    answers = next_views(fit)
    best, worst = answers[0], answers[-1]
    reached = []
    for one in (best, worst):
        pose = chart_at(fit.state.camera, one.at, one.yaw_deg, one.pitch_deg, one.distance_mm)
        image = PLAIN.project(pose.apply(taken.true_nodes))
        inside = np.flatnonzero(((image >= 0) & (image <= np.array(PLAIN.size) - 1)).all(axis=1))
        points = image[inside] + 0.01 * np.random.default_rng(1).standard_normal((len(inside), 2))
        more = [*fit.problem.views, ChartView("more", inside, points, np.tile(1e-4 * np.eye(2), (len(inside), 1, 1)))]
        start = replace(fit.state, poses=(*fit.state.poses, pose))
        again = fit_formula("OPENCV", start, replace(fit.problem, views=more))
        reached.append(next_views(again)[0].before)
    assert best.after < 0.8 * best.before
    assert reached[0] < reached[1]
    # predicted with the noise of the residuals of five views, 640 coordinates, and for known errors of the print
    assert reached[0] == pytest.approx(best.after, rel=0.25)


def test_the_nearer_sides_are_named():
    pose = chart_at(_camera(), (0.5, 0.5), 35.0, 0.0, 500.0)
    right, left = pose.apply(np.array([[50.0, 0, 0], [-50.0, 0, 0]]))
    assert right[2] < left[2]
    upper, lower = chart_at(_camera(), (0.5, 0.5), 0.0, 35.0, 500.0).apply(np.array([[0.0, -50, 0], [0.0, 50, 0]]))
    assert upper[2] < lower[2]
    words = next_view_words(NextView((0.2, 0.8), 35.0, 0.0, 512.3, 0.1, 0.05))
    assert words == "the lower left of the frame, 512 mm away, its right edge nearer by a turn of 35 degrees"


def _camera():
    return simple_camera("PINHOLE", (900.0, 900.0), (320.0, 240.0), (641, 481))


def test_planned_views_tilt_to_several_sides_and_none_is_planned_for_too_large_a_chart():
    views, poses = planned(LONG, 5, (0.25, 0.3))
    reached = [one.after for one in views]
    assert {one.at[0] for one in views} <= {0.25, 0.5, 0.75}
    assert sorted(reached, reverse=True) == reached
    assert reached[-1] < reached[0] / 5**0.5  # as by the same view five times
    assert len({tuple(np.round(pose.R[2], 1)) for pose in poses}) >= 3
    assert planned_view(LONG, [], chart_nodes(5.0), 1700.0, 0.02, (0.25, 0.3)) is None


LONG = simple_camera("OPENCV", (4000.0, 4000.0), (319.5, 239.5), (640, 480))


def planned(camera, count, rim):
    """Successive planned views, and their poses."""
    views, poses = [], []
    for _ in range(count):
        views.append(planned_view(camera, poses, chart_nodes(0.3), 1700.0, 0.02, rim))
        one = views[-1]
        poses.append(chart_at(camera, one.at, one.yaw_deg, one.pitch_deg, one.distance_mm))
    return views, poses


@pytest.mark.parametrize(("size", "rim"), [((640, 480), (0.13, 0.16)), ((3000, 2000), (0.07, 0.08))])
def test_six_planned_views_cover_as_much_of_the_frame_as_a_result_needs(size, rim):
    centre = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    camera = simple_camera("OPENCV", (2020.0, 2020.0), centre, size)
    points = np.concatenate([camera.project(pose.apply(chart_nodes(0.3))) for pose in planned(camera, 6, rim)[1]])
    outline = ConvexHull(points).volume / (size[0] * size[1])
    assert outline > SMALL_SHARE
    assert outline >= COVER - 0.02  # the least gain of a view


def test_planned_views_are_not_too_oblique_and_enclose_the_expected_area():
    # a wide lens: its corners are 37 degrees off the axis
    camera = simple_camera("OPENCV", (2000.0, 2000.0), (1499.5, 999.5), (3000, 2000))
    poses = planned(camera, 12, (0.1, 0.1))[1]
    for before, pose in zip([None, *poses], poses, strict=False):
        sight = pose.t / np.linalg.norm(pose.t)
        for one in (pose, before) if before else (pose,):
            assert np.degrees(np.arccos(sight @ one.R[:, 2])) <= STEEPEST_DEG + 1e-6
    nodes = chart_nodes(0.3)
    width = 4000 * np.ptp(nodes[:, 0]) / 1700.0
    enclosed = (0.6 * 639 + width) * (0.5 * 479 + width) / (640 * 480)
    # the chart hangs on a sphere about the camera: farther off by the square of 3 degrees, half of it
    assert corner_share(LONG, nodes, 1700.0, (0.2, 0.25)) == pytest.approx(enclosed, rel=0.003)


def test_a_view_for_a_pixel_improves_its_direction_most(few):
    x, y = 0.85 * PLAIN.size[0], 0.8 * PLAIN.size[1]
    best = next_views(few[1], (x, y))[0]
    assert best.after < 0.9 * best.before
    whole = next_views(few[1])[0]
    assert best.of.startswith("direction of pixel")
    # the direction of that pixel is improved at least as much as by the view for the whole frame
    same = next(
        one for one in next_views(few[1], (x, y))
        if (one.at, one.yaw_deg, one.pitch_deg, one.distance_mm)
        == (whole.at, whole.yaw_deg, whole.pitch_deg, whole.distance_mm)
    )  # fmt: skip
    assert best.after <= same.after
