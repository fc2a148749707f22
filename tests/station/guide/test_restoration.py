"""The plan of a restoration without a bench, and what is kept of the IMU on one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.clock import SystemClock
from procedures.plan import HAS_SHAKER, Ask, Shake
from procedures.raw import Carried, Exposure, Felt, RawFrame
from procedures.restoration.masks.camera_motion import poses_on
from procedures.restoration.two_photographs import rig_poses
from station.calibration.restoration.inputs import poses_table, read_poses
from station.guide.catalogue import plan_named
from station.guide.frontend import Result, Trouble
from station.guide.run import Run
from station.guide.scripted import Scripted
from station.guide.session_result import carried_during, compute
from station.guide.vibration import Patience
from station.sessions.session import Session

from . import benches


@pytest.mark.slow
def test_two_photographs_of_a_folder_become_picture_and_depth(tmp_path, shared_data):
    card = tmp_path / "card"
    card.mkdir()
    taken = []

    def photograph(ask):
        which = 2 if any(one.key == "second" for one in operator.asked) else 1
        image = cv2.imread(str(shared_data / f"synthetic/restoration/defocus_40dB_{which}.pgm"), cv2.IMREAD_UNCHANGED)
        part = image[40:112, 60:140].astype(np.uint16)
        # another last bit for every photograph: two that are the same never both count
        part = np.minimum(part * (65535 // int(image.max())), 60000) + len(taken)
        taken.append(cv2.imwrite(str(card / f"{len(taken):03d}.png"), part))
        return True

    answers = {"frames_folder": str(card), "photographed": photograph, "max_w": 4.0, "look": "go on"}
    operator = Scripted({**answers, "first_f_number": 5.0, "second_f_number": 4.0})
    plan = plan_named("restoration")
    with Session.create(tmp_path, plan=plan.name, camera="C", lens="L", config={}, clock=SystemClock()) as session:
        session.learn({"scheme": "1x(3+3)+1x3"})
        ended = Run(plan, None, session, operator, Patience(quiet=1.0)).go()
        (result,) = (event for event in operator.heard if isinstance(event, Result))
        again = tmp_path / "again"
        compute(session.folder, replace(session.state, results=()), plan, again)
    assert ended.how == "finished"
    assert {"sharp.tiff", "w.npy", "depth.png", "report.html", "result.json"} <= {
        one.name for one in result.folder.iterdir()
    }
    assert json.loads((result.folder / "result.json").read_text())["verdict"] in ("pass", "doubtful")
    assert ended.report == result.folder / "report.html"
    for one in result.folder.iterdir():
        assert (again / one.name).read_bytes() == one.read_bytes(), one.name


@pytest.mark.slow
def test_the_imu_s_samples_about_the_exposure_are_kept(tmp_path):
    shoot = replace(benches.short_plan().step("shots").requests[0], record_motion=True)
    with benches.quick_bench(tmp_path) as bench, benches.new_session(tmp_path, bench) as session:
        Run(benches.short_plan(shoot=shoot), bench, session, Scripted()).go()
        shots = session.state.counting()
    for shot in shots:
        motion = shot.snapshot["motion"]
        t = np.array(motion["host_s"])
        closed_s = shot.exposure["shutter"]["closed_s"]
        assert t.min() < closed_s + 0.02
        assert t.max() > closed_s + 0.5
        np.testing.assert_allclose(np.median(np.diff(t)), 0.005, atol=1e-5)
        # gravity, however the head is turned; sways have no mean
        assert abs(np.linalg.norm(np.mean(motion["acceleration_m_s2"], axis=0)) - 9.80665) < 0.1
        assert np.asarray(motion["rotation_rad_s"]).shape == (len(t), 3)


ROUND = Shake(0.2, {"x_mm": (0.0, 0.6, 0.9, 0.6, 0.0, -0.6, -0.9, -0.6), "y_mm": (0.5, 0.3, 0.0, -0.3) * 2})


def shaken_run(folder, spoil=lambda bench: None, **quick):
    """The shots of a short plan that shakes the camera, what the operator heard, and the truth of the bench."""
    shoot = replace(benches.short_plan().step("shots").requests[0], record_motion=True, shake=lambda facts: ROUND)
    with benches.quick_bench(folder, shaker=True, **quick) as bench, benches.new_session(folder, bench) as session:
        spoil(bench)
        operator = Scripted()
        plan = benches.short_plan(shoot=shoot)
        ended = Run(replace(plan, steps=(plan.step("shots"),)), bench, session, operator).go()
        return session.state.counting(), operator.heard, bench.simulated, ended


def test_a_shaker_carries_the_camera_along_the_path_that_is_kept(tmp_path):
    shots, _, truth, ended = shaken_run(tmp_path)
    assert ended.how == "finished"
    assert len(shots) == 2
    for shot, opening in zip(shots, truth.body.openings[-len(shots) :], strict=True):
        poses = poses_on(carried_during(shot), opening.exposure_s)
        t_s = opening.begin_s + np.linspace(0, opening.exposure_s, len(poses.position_m))
        sway = truth.world.sway(t_s)
        # x right, y down; the world's modes, which the move before and the shutter shook, sway by hundredths of a
        # millimetre and less
        np.testing.assert_allclose(1000 * poses.position_m[:, 0], sway["x_mm"][0], atol=0.02)
        np.testing.assert_allclose(-1000 * poses.position_m[:, 1], sway["y_mm"][0], atol=0.02)
        (tmp_path / "poses.csv").write_bytes(poses_table(poses, opening.exposure_s))
        again = read_poses(tmp_path / "poses.csv")
        np.testing.assert_allclose(again.position_m, poses.position_m, atol=1e-9)  # nine digits of millimetres
        assert np.ptp(sway["x_mm"][0]) > 0.2
    # at rest afterwards, and before the first of them
    assert abs(truth.world.sway(np.array([truth.clock.now_s() + 60.0]))["x_mm"][0][0]) < 1e-3


def test_a_shaker_that_comes_to_rest_too_early_is_told_and_the_photograph_is_kept(tmp_path):
    def spoil(bench):
        fire = bench.shutter.fire

        def cut(*args):
            bench.shutter.abort()
            return fire(*args)

        bench.shutter.fire = cut

    shots, heard, _, ended = shaken_run(tmp_path, spoil)
    assert ended.how == "finished"
    assert len(shots) == 2
    assert not any("shake" in shot.snapshot for shot in shots)
    assert any(isinstance(one, Trouble) and "came to rest before its time" in one.reason for one in heard)


def test_the_restoration_knows_the_commanded_path_before_what_was_felt():
    circle = np.column_stack([np.cos(np.arange(12) * np.pi / 6), np.sin(np.arange(12) * np.pi / 6), np.zeros(12)])
    carried = Carried(1e-3 * circle, 0.01, 0.02)
    t = np.arange(-0.2, 0.4, 0.005)
    still = Felt(t, np.tile([0.0, 9.81, 0.0], (len(t), 1)), np.zeros((len(t), 3)))
    exposure = Exposure(exposure_s=0.1)
    frame = RawFrame(Path("a.dng"), "", {}, exposure, still, carried)
    np.testing.assert_array_equal(rig_poses(frame).position_m, poses_on(carried, 0.1).position_m)
    # a part of a round that began nobody knows where: then it is what was felt
    lost = replace(frame, carried=replace(carried, since_s=None))
    assert np.abs(rig_poses(lost).position_m).max() < 1e-9
    assert rig_poses(replace(lost, felt=None)) is None


def asked(facts):
    """The keys of the plan's questions that hands have to answer."""
    everything = [one for step in plan_named("restoration").steps for one in step.requests if isinstance(one, Ask)]
    return {one.key for one in everything if one.when(facts) and one.given(facts) is None}


def test_nobody_is_asked_what_a_shaker_does():
    assert "blur_by" not in asked({HAS_SHAKER: True})
    shaken, by_hand = asked({HAS_SHAKER: True, "blur_by": "motions"}), asked({"blur_by": "motions"})
    assert by_hand - shaken == {"blur_by", "region", "first", "first_moves", "second"}
    # the apertures remain to be chosen, and then hands do it
    assert asked({HAS_SHAKER: True, "blur_by": "apertures"}) == asked({"blur_by": "apertures"})
    assert "second_f_number" in asked({"blur_by": "apertures"})
