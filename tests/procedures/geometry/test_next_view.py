from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from procedures.geometry.cameras import simple_camera
from procedures.geometry.choice import first_state, fit_model
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
from procedures.geometry.shape import shape_model
from procedures.geometry.views import ChartView, chart_nodes

from .conftest import PLAIN, SMALL
from .simulated_views import take


@pytest.fixture(scope="module")
def few():
    """Five views near the middle of the frame, and what they make of the camera."""
    taken = take(replace(SMALL, camera=PLAIN, print_mm=0.0, width_px=1200.0), np.random.default_rng(3))
    views = [view for view, pose in zip(taken.views, taken.poses, strict=True) if abs(pose.t[0]) < 0.2 * pose.t[2]][:5]
    shape = shape_model(taken.nodes, 0.001)
    start = first_state(taken.nodes, views, PLAIN.size, shape)
    return taken, views, shape, fit_model("OPENCV", start, taken.nodes, views, shape)


@pytest.mark.slow
def test_the_view_that_is_proposed_does_what_is_promised(few):
    taken, views, shape, found = few
    answers = next_views(found, taken.nodes, tuple(views), shape)
    best, worst = answers[0], answers[-1]
    reached = []
    for one in (best, worst):
        pose = chart_at(found.state.camera, one.at, one.yaw_deg, one.pitch_deg, one.distance_mm)
        seen = PLAIN.project(pose.apply(taken.true_nodes))
        inside = np.flatnonzero(((seen >= 0) & (seen <= np.array(PLAIN.size) - 1)).all(axis=1))
        points = seen[inside] + 0.01 * np.random.default_rng(1).standard_normal((len(inside), 2))
        more = [*views, ChartView("more", inside, points, np.tile(1e-4 * np.eye(2), (len(inside), 1, 1)))]
        start = replace(found.state, poses=(*found.state.poses, pose))
        again = fit_model("OPENCV", start, taken.nodes, more, shape)
        reached.append(next_views(again, taken.nodes, tuple(more), shape)[0].before_px)
    assert best.after_px < 0.8 * best.before_px
    assert reached[0] < reached[1]
    # promised with the noise that five views' residuals tell, 640 coordinates, and the print's errors known
    assert reached[0] == pytest.approx(best.after_px, rel=0.25)


def test_the_sides_that_are_nearer_are_named_as_they_are():
    pose = chart_at(_camera(), (0.5, 0.5), 35.0, 0.0, 500.0)
    right, left = pose.apply(np.array([[50.0, 0, 0], [-50.0, 0, 0]]))
    assert right[2] < left[2]
    upper, lower = chart_at(_camera(), (0.5, 0.5), 0.0, 35.0, 500.0).apply(np.array([[0.0, -50, 0], [0.0, 50, 0]]))
    assert upper[2] < lower[2]
    told = next_view_words(NextView((0.2, 0.8), 35.0, 0.0, 512.3, 0.1, 0.05))
    assert told == "the lower left of the frame, 512 mm away, its right edge nearer by a turn of 35 degrees"


def _camera():
    return simple_camera("PINHOLE", (900.0, 900.0), (320.0, 240.0), (641, 481))


def test_views_planned_one_after_the_other_go_to_several_sides_and_tell_more_and_more():
    camera = simple_camera("OPENCV", (4000.0, 4000.0), (319.5, 239.5), (640, 480))
    nodes = chart_nodes(0.3)
    poses, reached = [], []
    for _ in range(5):
        wanted = planned_view(camera, poses, nodes, 1700.0, 0.02, (0.25, 0.3))
        poses.append(chart_at(camera, wanted.at, wanted.yaw_deg, wanted.pitch_deg, wanted.distance_mm))
        reached.append(wanted.after_px)
        assert wanted.at[0] in (0.25, 0.5, 0.75)
    assert sorted(reached, reverse=True) == reached
    assert reached[-1] < reached[0] / 5**0.5  # what the same view five times would do
    assert len({tuple(np.round(pose.R[2], 1)) for pose in poses}) >= 3


def test_no_view_is_planned_where_the_chart_is_larger_than_the_frame():
    camera = simple_camera("OPENCV", (4000.0, 4000.0), (319.5, 239.5), (640, 480))
    assert planned_view(camera, [], chart_nodes(5.0), 1700.0, 0.02, (0.25, 0.3)) is None


def planned(camera, count, rim, distance_mm=1700.0, cell_mm=0.3):
    """Views one after the other, each chart in the pose that was planned for it."""
    poses = []
    for _ in range(count):
        wanted = planned_view(camera, poses, chart_nodes(cell_mm), distance_mm, 0.02, rim)
        poses.append(chart_at(camera, wanted.at, wanted.yaw_deg, wanted.pitch_deg, wanted.distance_mm))
    return poses


@pytest.mark.parametrize(("size", "rim"), [((640, 480), (0.13, 0.16)), ((3000, 2000), (0.07, 0.08))])
def test_six_planned_views_cover_as_much_of_the_frame_as_a_result_needs(size, rim):
    centre = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    camera = simple_camera("OPENCV", (2020.0, 2020.0), centre, size)
    seen = np.concatenate([camera.project(pose.apply(chart_nodes(0.3))) for pose in planned(camera, 6, rim)])
    outline = ConvexHull(seen).volume / (size[0] * size[1])
    assert outline > SMALL_SHARE
    assert outline >= COVER - 0.02  # a view must add that much to be worth a corner


def test_no_planned_view_is_seen_too_obliquely_to_be_found_neither_as_it_comes_nor_as_it_is_turned():
    # a wide lens: its corners are seen 37 degrees off the axis
    camera = simple_camera("OPENCV", (2000.0, 2000.0), (1499.5, 999.5), (3000, 2000))
    poses = planned(camera, 12, (0.1, 0.1))
    for before, pose in zip([None, *poses], poses, strict=False):
        sight = pose.t / np.linalg.norm(pose.t)
        for one in (pose, before) if before else (pose,):
            assert np.degrees(np.arccos(sight @ one.R[:, 2])) <= STEEPEST_DEG + 1e-6


def test_charts_in_the_corners_enclose_what_their_places_and_widths_say():
    camera = simple_camera("OPENCV", (4000.0, 4000.0), (319.5, 239.5), (640, 480))
    nodes = chart_nodes(0.3)
    width = 4000 * np.ptp(nodes[:, 0]) / 1700.0
    enclosed = (0.6 * 639 + width) * (0.5 * 479 + width) / (640 * 480)
    # the chart hangs on a sphere about the camera: farther off by the square of 3 degrees, half of it
    assert corner_share(camera, nodes, 1700.0, (0.2, 0.25)) == pytest.approx(enclosed, rel=0.003)
