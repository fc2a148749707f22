"""The plan of a restoration without a bench, and the stored IMU records on one."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.errors import SystemClock
from procedures import Refused, pillbox
from procedures.plan import HAS_SHAKER, Ask, Shake
from procedures.raw import Exposure, ImuRecord, RawFrame, ShakerPath
from procedures.restoration.known_blur import rig_poses
from procedures.restoration.masks.camera_motion import poses_on
from station.calibration.restoration.inputs import poses_table, read_poses
from station.common.durable_files import sha256_of
from station.guide.catalogue import plan_named
from station.guide.dialogue import Conversation
from station.guide.frontend import ProblemEvent, Result, Stopped
from station.guide.recompute import recompute
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.guide.session_report import session_page
from station.guide.session_result import estimate_of, shaker_path_during
from station.guide.vibration import SettlingTimeouts
from station.sessions.journal import Damaged
from station.sessions.session import Session

from . import benches


@pytest.mark.slow
def test_photographs_of_a_folder_and_a_shape_s_file_become_picture_and_depth_again_without_the_file(
    tmp_path, shared_data
):
    card, folder = tmp_path / "card", shared_data / "synthetic/restoration"
    card.mkdir()
    taken = []

    def image(which):
        if which == "truth":
            sharp = np.load(folder / "sharp.npy")
            return (sharp * image("first").mean() / sharp.mean()).astype(np.uint16)
        return cv2.imread(str(folder / f"defocus_40dB_{1 + (which == 'second')}.pgm"), cv2.IMREAD_UNCHANGED)

    def photograph(ask):
        which = next(one.key for one in reversed(operator.asked) if one.key in ("first", "second", "truth"))
        # a different last bit for every photograph: identical ones never both count
        part = np.minimum(image(which)[40:112, 60:140].astype(np.uint16), 60000) + len(taken)
        taken.append(cv2.imwrite(str(card / f"{len(taken):03d}.png"), part))
        return True

    shape = tmp_path / "shape.txt"
    np.savetxt(shape, pillbox()[::4, ::4])
    named = iter([str(tmp_path / "gone.npy"), str(shape)])
    answers = {"frames_folder": str(card), "photographed": photograph, "max_w": 4.0, "look": "go on"}
    apertures = {"first_f_number": 5.0, "second_f_number": 4.0, "truth_f_number": 16.0}
    operator = ScriptedOperator({**answers, **apertures, "ground_truth": "yes", "shape": lambda ask: next(named)})
    lab = Session.create(tmp_path, plan="restoration", camera="C", lens="L", config={}, clock=SystemClock())
    with lab as session:
        plan = plan_named("restoration", session.folder)
        session.learn({"scheme": "1x(3+3)+1x3"})
        ended = Run(plan, None, session, operator, SettlingTimeouts(quiet=1.0)).go()
    assert ended.how == "finished"
    # a missing file is reported when it is named, not when the photographs are taken
    assert "gone.npy" in next(one.reason for one in operator.heard if isinstance(one, ProblemEvent))
    (result,) = (event for event in operator.heard if isinstance(event, Result))
    assert {"sharp.tiff", "w.npy", "depth.png", "difference.tiff", "report.html", "result.json"} <= {
        one.name for one in result.folder.iterdir()
    }
    record = json.loads((result.folder / "result.json").read_text())
    assert record["verdict"] in ("pass", "doubtful")
    assert record["parameters"]["shape"] == "given/1/shape.txt"
    assert record["ground_truth"]["psnr_db"] > max(record["ground_truth"]["before_db"])
    assert ended.report == result.folder / "report.html"
    assert f"{sha256_of(shape)}  given/1/shape.txt" in (session.folder / "SHA256SUMS").read_text()
    shape.write_text("no shape any more")
    (again,) = recompute(session.folder)
    assert again.identical
    kept = session.folder / "given/1/shape.txt"
    kept.chmod(0o644)
    kept.write_text("0 1 0")
    with pytest.raises(Damaged, match=r"given/1/shape\.txt"):
        next(recompute(session.folder))


@pytest.mark.slow
def test_the_imu_s_samples_about_the_exposure_are_kept(tmp_path):
    shoot = replace(benches.short_plan().step("shots").requests[0], record_motion=True)
    with benches.quick_bench(tmp_path) as bench, benches.new_session(tmp_path, bench) as session:
        Run(benches.short_plan(shoot=shoot), bench, session, ScriptedOperator()).go()
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
    """The shots of a short plan that shakes the camera, the events, and the truth of the bench."""
    shoot = replace(benches.short_plan().step("shots").requests[0], record_motion=True, shake=lambda facts: ROUND)
    with benches.quick_bench(folder, shaker=True, **quick) as bench, benches.new_session(folder, bench) as session:
        spoil(bench)
        operator = ScriptedOperator()
        plan = benches.short_plan(shoot=shoot)
        ended = Run(replace(plan, steps=(plan.step("shots"),)), bench, session, operator).go()
        return session.state.counting(), operator.heard, bench.simulated, ended


def test_a_shaker_moves_the_camera_along_the_stored_path(tmp_path):
    shots, _, truth, ended = shaken_run(tmp_path)
    assert ended.how == "finished"
    assert len(shots) == 2
    for shot, opening in zip(shots, truth.body.openings[-len(shots) :], strict=True):
        poses = poses_on(shaker_path_during(shot), opening.exposure_s)
        t_s = opening.begin_s + np.linspace(0, opening.exposure_s, len(poses.position_m))
        sway = truth.world.sway(t_s)
        # x right, y down; the world's modes, excited by the move before and by the shutter, sway by hundredths of
        # a millimetre or less
        np.testing.assert_allclose(1000 * poses.position_m[:, 0], sway["x_mm"][0], atol=0.02)
        np.testing.assert_allclose(-1000 * poses.position_m[:, 1], sway["y_mm"][0], atol=0.02)
        (tmp_path / "poses.csv").write_bytes(poses_table(poses, opening.exposure_s))
        again = read_poses(tmp_path / "poses.csv")
        np.testing.assert_allclose(again.position_m, poses.position_m, atol=1e-9)  # nine digits of millimetres
        assert np.ptp(sway["x_mm"][0]) > 0.2
    # at rest afterwards, and before the first of them
    assert abs(truth.world.sway(np.array([truth.clock.now_s() + 60.0]))["x_mm"][0][0]) < 1e-3


def test_a_shaker_that_stops_too_early_is_reported_and_the_photograph_is_kept(tmp_path):
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
    assert any(isinstance(one, ProblemEvent) and "stopped too early" in one.reason for one in heard)


def test_the_restoration_prefers_the_commanded_path_to_the_imu_record():
    circle = np.column_stack([np.cos(np.arange(12) * np.pi / 6), np.sin(np.arange(12) * np.pi / 6), np.zeros(12)])
    shaker_path = ShakerPath(1e-3 * circle, 0.01, 0.02)
    t = np.arange(-0.2, 0.4, 0.005)
    still = ImuRecord(t, np.tile([0.0, 9.81, 0.0], (len(t), 1)), np.zeros((len(t), 3)))
    exposure = Exposure(exposure_s=0.1)
    frame = RawFrame(Path("a.dng"), "", {}, exposure, still, shaker_path)
    np.testing.assert_array_equal(rig_poses(frame).position_m, poses_on(shaker_path, 0.1).position_m)
    # a part of a round with an unknown start: then the IMU record is used
    lost = replace(frame, shaker_path=replace(shaker_path, since_s=None))
    assert np.abs(rig_poses(lost).position_m).max() < 1e-9
    assert rig_poses(replace(lost, imu=None)) is None


def asked(facts):
    """The keys of the plan's questions for manual work."""
    everything = [one for step in plan_named("restoration").steps for one in step.requests if isinstance(one, Ask)]
    return {one.key for one in everything if one.when(facts) and one.given(facts) is None}


def test_a_shaker_needs_no_questions():
    (kind,) = (one for one in plan_named("restoration").steps[0].requests
               if isinstance(one, Ask) and one.key == "blur_by" and one.when({HAS_SHAKER: True}))  # fmt: skip
    assert kind.default == "motions"
    shaken, by_hand = asked({HAS_SHAKER: True, "blur_by": "motions"}), asked({"blur_by": "motions"})
    assert by_hand - shaken == {"motion_shape", "region", "steady", "first", "first_moves", "second"}
    # the apertures remain to be chosen, and are set by hand
    assert asked({HAS_SHAKER: True, "blur_by": "apertures"}) == asked({"blur_by": "apertures"})
    assert "second_f_number" in asked({"blur_by": "apertures"})


def test_a_psf_is_kept_with_its_record_and_read_from_the_copy(tmp_path):
    given = tmp_path / "psf"
    given.mkdir()
    np.save(given / "psf_Y.npy", np.pad(np.ones((9, 9)), 4))
    operator = ScriptedOperator({"shape": f"pillbox; {given / 'psf_Y.npy'}"})
    with Session.create(tmp_path, plan="restoration", camera="C", lens="L", config={}, clock=SystemClock()) as session:
        plan = plan_named("restoration", session.folder)
        talk, ask = Conversation(operator, session, None), plan.asks()["shape"]
        with pytest.raises(Stopped):
            talk.ask(ask)
        assert "no result.json in its folder" in operator.heard[-1].reason
        (given / "result.json").write_text(json.dumps({"parameters": {"s": 3}}))
        assert talk.ask(ask) == "pillbox; given/1/psf_Y.npy"
        # the known answer is accepted unchanged
        session.learn({"shape": "pillbox; given/1/psf_Y.npy"})
        operator.answers = {"shape": lambda ask: ask.default}
        assert talk.ask(ask) == "pillbox; given/1/psf_Y.npy"
        assert list(session.state.given) == ["given/1/psf_Y.npy", "given/1/result.json"]
        # of a lens symmetric about its axis every file is kept
        operator.answers = {"shape": f"radial:{given / 'psf_Y.npy'},{given / 'psf_Y.npy'}"}
        assert talk.ask(ask) == "radial:given/2/psf_Y.npy,given/3/psf_Y.npy"
    shutil.rmtree(given)
    read = estimate_of(plan_named("restoration", session.folder)).estimate.keywords["read"]
    assert read("given/1/psf_Y.npy", "Y", (80, 96)).half_width_px == pytest.approx(4.5 / 3)
    assert read("radial:given/2/psf_Y.npy,given/3/psf_Y.npy", "Y", (80, 96)).half_width_px == pytest.approx(4.5 / 3)


def test_a_refused_restoration_ends_without_a_page(tmp_path):
    plan = plan_named("restoration")
    with Session.create(tmp_path, plan=plan.name, camera="C", lens="L", config={}, clock=SystemClock()) as session:
        for step in plan.steps:
            session.begin_step(step.name)
            session.finish_step(step.name)
        session.result_folder().mkdir(parents=True)
        (session.result_folder() / "result.json").write_text("{}")
        session.keep_result(step="estimate", shots=[], verdict="refused")
        ended = Run(plan, None, session, ScriptedOperator()).go()
    assert (ended.how, ended.report) == ("finished", None)
    with pytest.raises(Refused, match="a refused result of restoration has no page; see the reason"):
        session_page(session.folder)
