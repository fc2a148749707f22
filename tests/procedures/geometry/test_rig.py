"""Two cameras on a rig with known poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures.geometry.adjustment import moved_pose
from procedures.geometry.rig import PosedCharts, estimate_rig, posed_charts
from procedures.geometry.shape import scale_spread
from procedures.geometry.views import Pose
from procedures.outcome import Verdict

from .simulated_views import Shoot, plan, printed, similarity, true_poses

TRUE = Pose(Rotation.from_rotvec([0.02, -0.15, 0.01]).as_matrix(), np.array([-120.0, 3.0, 8.0]))
FIRST = true_poses(Shoot(count=8))
NAMES = tuple(f"{i}.dng" for i in range(8))


def in_second(pose: Pose) -> Pose:
    return Pose(TRUE.R @ pose.R, TRUE.R @ pose.t + TRUE.t)


@pytest.fixture(scope="module")
def covariance() -> np.ndarray:
    """Of eight poses with common errors: 1e-4 rad, 0.1 mm across and 0.4 mm along the line of sight."""
    rng = np.random.default_rng(1)
    scale = np.tile([1e-4, 1e-4, 1e-4, 0.1, 0.1, 0.4], 8)
    root = rng.standard_normal((48, 60)) / np.sqrt(60) + np.tile(rng.standard_normal((6, 60)), (8, 1)) / 10
    return (root @ root.T) * np.outer(scale, scale)


def drawn(poses, covariance, rng, names=NAMES) -> PosedCharts:
    changes = (np.linalg.cholesky(covariance) @ rng.standard_normal(len(covariance))).reshape(-1, 6)
    moved = tuple(moved_pose(pose, change) for pose, change in zip(poses, changes, strict=True))
    return PosedCharts(names, moved, covariance)


def both(covariance, rng):
    return drawn(FIRST, covariance, rng), drawn([in_second(one) for one in FIRST], covariance, rng)


def off(found) -> np.ndarray:
    turn = found.pose.R @ TRUE.R.T
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), found.pose.t - turn @ TRUE.t])


@pytest.mark.slow
def test_the_stated_covariance_of_the_rig_is_right(covariance):
    rng, squares, doubts = np.random.default_rng(2), [], 0
    for _ in range(100):
        outcome = estimate_rig(*both(covariance, rng))
        error, known = off(outcome.value), outcome.value.covariance / max(outcome.value.misfit, 1.0) ** 2
        squares.append(error @ np.linalg.solve(known, error))
        doubts += outcome.verdict is Verdict.DOUBTFUL
    # chi square of 6 degrees: mean 6 +- sqrt(12 / 100) = 0.35
    assert abs(np.mean(squares) - 6) < 1.4
    assert np.mean(np.array(squares) < 12.59) == pytest.approx(0.95, abs=0.08)  # 95 %, 2.2 % from 100
    assert doubts <= 2


def test_the_print_s_scale_is_in_the_baseline(covariance):
    first, second = both(1e-6 * covariance, np.random.default_rng(3))
    found = estimate_rig(first, replace(second, scale_uncertainty=0.003)).value
    length = np.linalg.norm(TRUE.t)
    assert found.numbers()["baseline"].value == pytest.approx(length, abs=0.01)
    assert found.numbers()["baseline"].uncertainty == pytest.approx(0.003 * length, rel=0.01)
    assert found.numbers()["turn"].value == pytest.approx(np.degrees(np.linalg.norm([0.02, -0.15, 0.01])), abs=1e-3)


def test_a_photograph_of_another_time_is_doubtful(covariance):
    first, second = both(covariance, np.random.default_rng(4))
    swapped = PosedCharts(second.sources, (*second.poses[1:2], *second.poses[:1], *second.poses[2:]), covariance)
    outcome = estimate_rig(first, swapped)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "taken at one time" in outcome.remedy


def test_charts_are_matched_by_name_or_else_by_order(covariance):
    first, second = both(1e-6 * covariance, np.random.default_rng(5))
    some = second.chosen([5, 0, 3, 6])
    assert estimate_rig(first, some).value.charts == ("0.dng", "3.dng", "5.dng", "6.dng")
    other = PosedCharts(tuple(f"right-{name}" for name in NAMES), second.poses, second.covariance)
    assert np.abs(off(estimate_rig(first, other).value)[3:]).max() < 0.01
    few = estimate_rig(first, other.chosen([0, 1, 2]))
    assert few.verdict is Verdict.REFUSED
    assert "no name in common" in few.reason
    assert "3 charts" in estimate_rig(first, some.chosen([0, 1])).reason


def test_the_scale_due_to_errors_of_the_print_has_the_stated_spread():
    taken = Shoot(print_mm=0.05, every=3)
    nodes, rng = plan(taken), np.random.default_rng(6)
    scales = [similarity(nodes, printed(taken, rng))[2] - 1 for _ in range(400)]
    # of 400 prints: a standard deviation is known to 3.5 %
    assert scale_spread(nodes, np.array([0.05, 0.05, 0.0])) == pytest.approx(np.std(scales), rel=0.12)


def test_a_calibrated_camera_provides_the_poses_of_its_charts(geometry):
    charts = posed_charts(geometry)
    for i, one in enumerate(geometry.views):
        block = charts.covariance[6 * i : 6 * i + 6, 6 * i : 6 * i + 6]
        np.testing.assert_allclose(block, one.pose_covariance)
    assert charts.sources[0] == geometry.views[0].view.source
    assert charts.scale_uncertainty == geometry.shape.scale_uncertainty > 0.003
