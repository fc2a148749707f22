"""Cameras on a rig with known poses, which see one chart through lenses that are drawn by OpenCV."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures.geometry.cameras import simple_camera
from procedures.geometry.next_view import chart_at
from procedures.geometry.rig import RigCamera, RigPoses, estimate_rig
from procedures.geometry.shape import scale_spread
from procedures.geometry.views import Pose
from procedures.outcome import Verdict

from .simulated_views import Shoot, TrueCamera, plan, printed, seen, similarity, true_poses

HERE = Pose(np.eye(3), np.zeros(3))
TRUE = Pose(Rotation.from_rotvec([0.02, 0.1, 0.01]).as_matrix(), np.array([-50.0, 3.0, 8.0]))
THIRD = Pose(Rotation.from_rotvec([-0.03, 0.02, 0.3]).as_matrix(), np.array([30.0, -20.0, 4.0]))
NO_PRISM = (0.0, 0.0, 0.0, 0.0)
LENSES = (
    TrueCamera(radial=(-0.12, 0.06, 0.0), thin_prism=(4e-4, 0.0, -2e-4, 0.0)),
    TrueCamera((4300.0, 4304.0), (2990.0, 2004.0), radial=(-0.1, 0.05, 0.0), thin_prism=NO_PRISM),
    TrueCamera((4100.0, 4101.0), (3010.0, 1980.0), radial=(0.05, 0.0, 0.0), thin_prism=NO_PRISM),
)
SHOOT = Shoot(LENSES[0], count=8, every=4, noise_px=0.03, print_mm=0.02, bend_mm=0.2, width_px=1800.0)


def rig(rng: np.random.Generator, stands=(HERE, TRUE), shoot: Shoot = SHOOT) -> list[RigCamera]:
    """The cameras, as calibrations of each alone would begin."""
    nodes, poses, cameras = printed(shoot, rng), true_poses(shoot), []
    for lens, stand in zip(LENSES, stands, strict=False):
        stood = [Pose(stand.R @ one.R, stand.R @ one.t + stand.t) for one in poses]
        start = simple_camera("OPENCV", lens.focal_px, lens.centre, lens.size)
        params = np.array([*start.params[:4], *lens.radial[:2], *lens.tangential])
        views = seen(replace(shoot, camera=lens), stood, nodes, rng)
        cameras.append(RigCamera(start.with_params(params), tuple(views), tuple(stood), plan(shoot)))
    return cameras


def chosen(camera: RigCamera, places: list[int], names: str = "") -> RigCamera:
    views = tuple(replace(camera.views[i], source=names + camera.views[i].source) for i in places)
    return replace(camera, views=views, poses=tuple(camera.poses[i] for i in places))


def z(found: RigPoses, stands=(TRUE,)) -> np.ndarray:
    """Errors of all poses over their stated uncertainties."""
    errors = []
    for pose, truth in zip(found.poses, stands, strict=True):
        turn = pose.R @ truth.R.T
        errors += [Rotation.from_matrix(turn).as_rotvec(), pose.t - turn @ truth.t]
    return np.concatenate(errors) / np.sqrt(np.diag(found.covariance))


@pytest.fixture(scope="module")
def cameras() -> list[RigCamera]:
    return rig(np.random.default_rng(1))


def test_a_rig_is_within_its_uncertainty(cameras):
    outcome = estimate_rig(cameras)
    assert outcome.verdict is Verdict.PASS, outcome.reason
    assert np.abs(z(outcome.value)).max() < 2.5
    assert outcome.value.charts == cameras[0].sources


def test_the_proposed_chart_reduces_the_uncertainty_of_a_depth_as_predicted():
    shoot = replace(SHOOT, print_mm=0.0, bend_mm=0.0)
    few = [chosen(one, [0, 1, 2, 5]) for one in rig(np.random.default_rng(1), shoot=shoot)]
    first = estimate_rig(few, 5000.0).value.next_view
    assert first.of == "depth at 5 m, mm"
    assert first.after < 0.9 * first.before
    pose = chart_at(few[0].camera, first.at, first.yaw_deg, first.pitch_deg, first.distance_mm)
    more = []
    for one, lens, stand in zip(few, LENSES, (HERE, TRUE), strict=False):
        stood = Pose(stand.R @ pose.R, stand.R @ pose.t + stand.t)
        (view,) = seen(replace(shoot, camera=lens), [stood], one.nodes, np.random.default_rng(3))
        view = replace(view, source="proposed")
        more.append(replace(one, views=(*one.views, view), poses=(*one.poses, stood)))
    # predicted with noise, chart and discrepancy of four views
    assert estimate_rig(more, 5000.0).value.next_view.before == pytest.approx(first.after, rel=0.35)


def test_three_cameras_have_one_covariance():
    outcome = estimate_rig(rig(np.random.default_rng(2), (HERE, TRUE, THIRD)))
    assert outcome.value.covariance.shape == (12, 12)
    assert np.abs(z(outcome.value, (TRUE, THIRD))).max() < 3  # of twelve
    assert outcome.value.numbers_of(1)["baseline"].value == pytest.approx(np.linalg.norm(THIRD.t), abs=1)


@pytest.mark.slow
def test_all_six_numbers_are_within_their_uncertainties_in_twenty_draws():
    every = np.array([z(estimate_rig(rig(np.random.default_rng(seed))).value) for seed in range(20)])
    assert np.abs(every).max() < 2.5
    assert np.sqrt(np.mean(every**2)) > 0.4


def test_a_rig_names_what_makes_its_pairs_doubtful_or_refused(cameras):
    found = estimate_rig([replace(cameras[0], cell_uncertainty=0.05), cameras[1]]).value
    length = np.linalg.norm(TRUE.t)
    assert found.numbers()["baseline"].uncertainty == pytest.approx(0.05 * length, rel=0.05)
    assert found.numbers()["turn"].value == pytest.approx(np.degrees(np.linalg.norm([0.02, 0.1, 0.01])), abs=0.2)
    first, second = cameras
    swapped = [
        replace(second.views[i], source=name) for i, name in zip([1, 0, *range(2, 8)], second.sources, strict=True)
    ]
    poses = tuple(second.poses[i] for i in (1, 0, *range(2, 8)))
    outcome = estimate_rig([first, replace(second, views=tuple(swapped), poses=poses)])
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "taken at one time" in outcome.remedy
    few = chosen(second, [5, 0, 3, 6])
    assert sorted(estimate_rig([first, few]).value.charts) == [f"view0{i}" for i in (0, 3, 5, 6)]
    other = chosen(second, list(range(8)), "right-")
    assert np.abs(z(estimate_rig([first, other]).value)).max() < 2.5
    refused = estimate_rig([first, chosen(second, [0, 1, 2], "right-")])
    assert refused.verdict is Verdict.REFUSED
    assert "no name in common" in refused.reason
    assert "3 charts" in estimate_rig([first, chosen(second, [0, 1])]).reason
    outcome = estimate_rig([cameras[0], replace(cameras[1], nodes=1.1 * cameras[1].nodes)])
    assert "widths of their charts differ" in outcome.reason


def test_the_scale_due_to_errors_of_the_print_has_the_stated_spread():
    taken = Shoot(print_mm=0.05, every=3)
    nodes, rng = plan(taken), np.random.default_rng(6)
    scales = [similarity(nodes, printed(taken, rng))[2] - 1 for _ in range(400)]
    # of 400 prints: a standard deviation is known to 3.5 %
    assert scale_spread(nodes, np.array([0.05, 0.05, 0.0])) == pytest.approx(np.std(scales), rel=0.12)
