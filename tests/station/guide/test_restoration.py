"""The plan of a restoration without a bench, and what is kept of the IMU on one."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from drivers.clock import SystemClock
from station.guide.catalogue import plan_named
from station.guide.frontend import Result
from station.guide.run import Run
from station.guide.scripted import Scripted
from station.guide.session_result import compute
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
