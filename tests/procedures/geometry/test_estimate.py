from dataclasses import replace

import numpy as np
import pytest

from procedures import BadParameter, GeometryParameters, Verdict, calibrate_geometry
from procedures.geometry.views import ChartView, chart_nodes, greatest_tilt

from .conftest import PLAIN, SMALL
from .simulated_views import CELL_MM, apart, fixed_to_charts, similarity, take


def test_the_true_camera_lies_within_the_stated_uncertainties(geometry, taken):
    truth = {
        "fx": PLAIN.focal_px[0], "fy": PLAIN.focal_px[1], "cx": PLAIN.centre[0], "cy": PLAIN.centre[1],
        "k1": PLAIN.radial[0], "k2": PLAIN.radial[1], "p1": PLAIN.tangential[0], "p2": PLAIN.tangential[1],
    }  # fmt: skip
    error = np.array([geometry.numbers()[name].value - value for name, value in truth.items()])
    # Mahalanobis distance of eight numbers: a chi square of 8 degrees, beyond 26 once in a thousand
    assert error @ np.linalg.solve(geometry.covariance, error) < 26
    pixels = geometry.camera.frame_grid(9, 7)
    distance = geometry.maps[0].distance_mm
    poses = [one.pose for one in geometry.views]
    error = fixed_to_charts(geometry.camera, poses, taken, PLAIN, pixels, distance) - pixels
    stated = geometry.numbers()[f"projection_uncertainty_at_{distance:.0f}_mm"].value
    # one draw of a smooth field of a few freedoms: its rms is rarely beyond twice what is expected
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 2.5 * stated
    assert np.sqrt(np.mean(np.sum(apart(geometry.camera, PLAIN) ** 2, axis=1))) < 0.02
    R, t, s = similarity(taken.nodes, taken.true_nodes)
    true = ((taken.true_nodes - t) @ R) / s - taken.nodes
    error = geometry.shape.deviations_mm - true
    # 8 views of 0.01 pixel at 10 pixels per mm: 0.0004 mm; out of the plane tilts of 0.5 show half of it
    assert error[:, :2].std() < 0.002
    assert error[:, 2].std() < 0.004
    assert geometry.shape.node_mm[0] == pytest.approx(0.03, rel=0.2)  # of 64 nodes


def test_distances_are_right_to_the_scale_of_the_print(geometry, taken):
    _, _, s = similarity(taken.nodes, taken.true_nodes)
    for one, pose in zip(geometry.views, taken.poses, strict=True):
        true = np.linalg.norm(pose.t)
        assert abs(one.distance.value - true) < 3 * one.distance.uncertainty
        # without the unknown scale they agree a hundred times better; the middle of the bent sheet is off its plan
        assert one.distance.value * s == pytest.approx(true, rel=1e-3)


def test_a_model_that_is_too_simple_is_named_as_doubtful():
    taken = take(SMALL, np.random.default_rng(3))
    parameters = GeometryParameters(CELL_MM, model="OPENCV")
    found = calibrate_geometry(taken.views, SMALL.camera.size, parameters, nodes=taken.nodes)
    assert found.verdict is Verdict.DOUBTFUL
    assert "OPENCV is too simple for this lens" in found.reason
    assert found.value is not None
    assert found.value.misfit.rms_px > 0.02  # thin prism of 6e-4 r^2: a tenth of a pixel and more at the rim


def test_two_views_are_refused_and_few_are_doubtful(taken):
    found = calibrate_geometry(taken.views[:2], PLAIN.size, GeometryParameters(CELL_MM), nodes=taken.nodes)
    assert (found.value, found.verdict) == (None, Verdict.REFUSED)
    assert "needs 3 views of the chart and better 12; there are 2" in found.reason
    with pytest.raises(BadParameter, match="points must lie in the frame of 3000 x 2000"):
        calibrate_geometry(taken.views, (3000, 2000), GeometryParameters(CELL_MM), nodes=taken.nodes)
    parameters = GeometryParameters(CELL_MM, model="OPENCV")
    found = calibrate_geometry(taken.views[:5], PLAIN.size, parameters, nodes=taken.nodes)
    assert "5 views are too few" in found.reason


@pytest.mark.slow
def test_charts_square_to_the_camera_or_tilted_to_one_side_are_refused_for_that():
    taken = take(replace(SMALL, camera=PLAIN, tilt_deg=0.0, bend_mm=0.0), np.random.default_rng(6))
    found = calibrate_geometry(taken.views, PLAIN.size, GeometryParameters(CELL_MM, model="OPENCV"), nodes=taken.nodes)
    assert (found.value, found.verdict) == (None, Verdict.REFUSED)
    assert "square to the camera" in found.reason
    assert "turned by 20 to 40 degrees" in found.remedy
    taken = take(replace(SMALL, camera=PLAIN, tilt_deg=30.0, bend_mm=0.0), np.random.default_rng(6))
    view = max(taken.views, key=lambda one: greatest_tilt(taken.nodes, [one]))
    asked = GeometryParameters(CELL_MM, model="OPENCV")
    found = calibrate_geometry([view] * 6, PLAIN.size, asked, nodes=taken.nodes)
    assert found.verdict is Verdict.REFUSED
    assert "the chart is tilted the same way, within 5 degrees, in all 6 views" in found.reason


@pytest.mark.parametrize("tilt_deg", [0, 25, 40])
def test_foreshortening_gives_the_tilt_of_a_chart(tilt_deg):
    # seen from far away: no perspective; the tolerance is the cosine's rounding at 0 degrees
    turn = np.array([[1, 0], [0, np.cos(np.radians(tilt_deg))]])
    nodes = chart_nodes(CELL_MM)
    points = 8 * nodes[:, :2] @ turn + 500
    view = ChartView("", np.arange(len(nodes)), points, np.zeros((len(nodes), 2, 2)))
    assert greatest_tilt(nodes, [view]) == pytest.approx(tilt_deg, abs=1e-4)
