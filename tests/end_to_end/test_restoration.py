"""A scene in depth before the simulated bench's shaking rig: image and depth compared with the truth."""

import json
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from procedures.outcome import Verdict
from procedures.restoration.plan import estimate
from simulators.camera.sensor import Sensor
from station.bench.opening import simulated_bench
from station.calibration.restoration.inputs import read_imu
from station.guide.catalogue import plan_named
from station.guide.frontend import Result
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.guide.session_result import Frames
from station.sessions.session import Session

pytestmark = pytest.mark.nightly

NEAREST, ROUND, BACK = np.s_[10:110, 10:80], np.s_[5:45, 115:155], np.s_[76:110, 112:150]
"""Parts of the plane that show one sheet each, by where these hang."""


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    root = tmp_path_factory.mktemp("restoration")
    plan, operator = plan_named("restoration"), ScriptedOperator({"ground_truth": "yes"})
    bench = small_bench(root, 240, 320)
    view = bench.simulated.view
    session = Session.create(root, plan=plan.name, camera="C", lens="L", config={}, clock=bench.clock, seed=3)
    session.learn({"scheme": "2x(4+4)+1x8"})
    ended = Run(plan, bench, session, operator).go()
    (result,) = (event for event in operator.heard if isinstance(event, Result))
    state = session.state
    known = Frames(session.folder, state.counting())
    straight = estimate(known, {**state.facts, "pixel_pitch_um": 0.0}, {})["picture"].value.sharp[0]
    session.close()
    bench.close()
    w = np.load(result.folder / "w.npy")
    sharp = cv2.imread(str(result.folder / "sharp.tiff"), cv2.IMREAD_UNCHANGED)
    return SimpleNamespace(ended=ended, result=result, state=state, view=view, w=w, sharp=sharp, straight=straight)


def small_bench(root, rows, columns):
    """A bench whose camera has a small sensor."""
    incoming = root / "incoming"
    incoming.mkdir()
    bench = simulated_bench(incoming, seed=3, virtual_time=True)
    view = bench.simulated.view
    view.camera = replace(view.camera, sensor=Sensor(rows=rows, columns=columns))
    return bench


def test_it_passes_without_manual_work_and_depth_is_that_of_the_sheets(done):
    assert done.ended.how == "finished"
    assert done.result.verdict is Verdict.PASS, done.result.reason
    assert [shot.purpose for shot in done.state.counting()] == ["first", "second", "truth"]
    assert len(read_imu(done.result.folder / "imu_2.csv").time_s) > 50
    # the IMU measures the shaker: 1.9 mm at 10 Hz are 7.5 m/s^2 along the axis that it drives most
    for shot, axis in zip(done.state.counting()[:2], (0, 1), strict=True):
        imu = np.array(shot.snapshot["motion"]["acceleration_m_s2"])[:, axis]
        assert np.ptp(imu) / 2 == pytest.approx(0.0019 * (20 * np.pi) ** 2, rel=0.4)
    back, middle, front = (done.view.world.distance_mm(0.0) + sheet.behind_mm for sheet in done.view.sheets)
    assert json.loads((done.result.folder / "result.json").read_text())["w"]["unit"] == "1/m"
    for part, distance_mm in ((NEAREST, front), (ROUND, middle), (BACK, back)):
        # a twentieth for the noisy unit's amplitude and the spacing of levels, and what defocus, which the masks do not
        # know, adds
        assert np.median(done.w[part]) == pytest.approx(1000 / distance_mm, rel=0.08)
        assert np.percentile(np.abs(done.w[part] - np.median(done.w[part])), 80) < 0.03
    # the unit's scale error cancels in ratios
    medians = [np.median(done.w[part]) for part in (NEAREST, ROUND, BACK)]
    assert medians[1] / medians[0] == pytest.approx(front / middle, rel=0.04)
    assert medians[2] / medians[0] == pytest.approx(front / back, rel=0.04)


@pytest.mark.parametrize("part", [NEAREST, ROUND, BACK], ids=["nearest", "round", "back"])
def test_the_picture_is_as_sharp_as_from_a_still_rig(done, part):
    trial, first = (done.view.taken[i].plane("G1") for i in (-4, -3))
    restored = nearest_shift(done.sharp, trial)
    truth = trial[part] - trial[part].mean()

    def error(picture):
        seen = picture[part] * (trial[part].mean() / picture[part].mean())
        return float(np.std(seen - trial[part]) / truth.std())

    assert error(restored) < 0.4 * error(first)
    # the rig rotates: space-invariant masks give no improvement
    assert error(restored) < 0.4 * error(nearest_shift(done.straight, trial))
    fine = [float(np.std((p - gaussian_filter(p, 1.5))[part])) for p in (trial, restored, first)]
    assert fine[2] < 0.7 * fine[0]
    assert fine[1] == pytest.approx(fine[0], rel=0.25)


def test_the_photograph_at_rest_confirms_the_restoration(done):
    witness = json.loads((done.result.folder / "result.json").read_text())["ground_truth"]
    # the sharp trial photograph, which the restoration did not use
    trial, truth = (done.view.taken[i].plane("G1") for i in (-4, -1))
    assert np.std(nearest_shift(truth, trial) - trial) < 0.1 * trial.std()
    assert witness["psnr_db"] > max(witness["before_db"]) + 3
    # relative to the reported error, within the limit of a doubtful restoration
    assert witness["error"] < 2 * witness["stated_error"]


def nearest_shift(picture, like):
    """The image registered to the reference: the rest position after the trial is unknown."""
    steps = np.arange(-1.5, 1.6, 0.5)
    moved = [shift(picture, (dy, dx), order=3, mode="nearest") for dy in steps for dx in steps]
    return min(moved, key=lambda one: float(np.std(one - like)))
