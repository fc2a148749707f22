"""A calibration from the empty room to the report, by an operator who says yes to everything."""

import shutil
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from procedures import Verdict, estimate_psf, read_frame
from procedures.choice import COMMON, combined
from procedures.pattern_psf import plan as pattern_plan
from procedures.plan import Ask
from station.bench.opening import simulated_bench
from station.demo.truth_comparison import compare
from station.guide import session_report
from station.guide.catalogue import plan_named
from station.guide.frontend import Result, RunBegan, ScanEvent, StepEnded
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.guide.session_report import session_page
from station.guide.session_result import compute
from station.results.reader import read_record
from station.sessions.session import Session

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def estimated():
    """The planes that the plan has estimated, each time it did; the same samples have the same estimate."""
    found, known = [], {}

    def counted(plane, *rest):
        found.append(plane.name)
        samples = plane.samples.tobytes()
        known[samples] = known.get(samples) or estimate_psf(plane, *rest)
        return known[samples]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pattern_plan, "estimate_psf", counted)
        yield found


@pytest.fixture(scope="module")
def done(tmp_path_factory, estimated):
    """One run, stopped before its shots and resumed on another bench, as after a power cut."""
    root = tmp_path_factory.mktemp("guide")
    plan = plan_named("pattern")
    collected = SimpleNamespace(plan=plan, heard=[], asked=[], ends=[])
    folder = None
    for stop_at in ("wanted_mtf50", None):
        incoming = root / f"incoming-{stop_at}"
        incoming.mkdir()
        bench = simulated_bench(incoming, seed=3, virtual_time=True)
        view = bench.simulated.view
        view.camera = replace(view.camera, oversampling=5)  # its error stays far below the noise
        if folder is None:
            session = Session.create(root, plan="pattern", camera="C", lens="L", config={}, clock=bench.clock, seed=3)
            folder = session.folder
        else:
            session = Session.open(folder, bench.clock)
        operator = ScriptedOperator()
        run = Run(plan, bench, session, operator)

        def stop(ask: Ask, run=run):
            run.ask_to_stop()
            return ask.default

        operator.answers = {} if stop_at is None else {stop_at: stop}
        collected.ends.append(run.go())
        collected.heard += operator.heard
        collected.asked += operator.asked
        collected.view, collected.world = bench.simulated.view, bench.simulated.world
        collected.state = session.state
        session.close()
        bench.close()
    collected.folder = folder
    collected.estimated = list(estimated)
    return collected


@pytest.fixture(scope="module")
def again(done, estimated, tmp_path_factory):
    """The report drawn anew where it was altered: the page, what was computed for it, and how many planes were."""
    altered = shutil.copytree(done.folder, tmp_path_factory.mktemp("again") / "altered")
    (altered / "report.html").write_text("something else")
    before, found = len(estimated), []

    def kept(*args, **rest):
        found.append(compute(*args, **rest))
        return found[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session_report, "compute", kept)
        page = session_page(altered)
    return SimpleNamespace(page=page, computed=found[0], estimated=len(estimated) - before)


def test_every_plane_was_estimated_once_and_the_report_is_kept(done, estimated):
    shots = [shot for shot in done.state.counting() if shot.purpose == "shot"]
    assert len(shots) >= 3
    assert sorted(done.estimated) == sorted(name for _ in shots for name in ("R", "G1", "G2", "B"))
    before, page = len(estimated), done.ends[1].report.read_text()
    assert session_page(done.folder) == page
    assert len(estimated) == before


def test_errors_of_the_setup_were_corrected_and_an_altered_report_is_recomputed(done, again):
    assert again.page.startswith("<!doctype html>")
    assert again.estimated == len(done.estimated)
    assert [end.how for end in done.ends] == ["stopped", "finished"]
    assert done.state.done == tuple(step.name for step in done.plan.steps)
    assert done.ends[1].report.read_text().startswith("<!doctype html>")
    assert [e.done for e in done.heard if isinstance(e, RunBegan)] == [
        (),
        ("print", "mount", "distance", "square", "focus"),
    ]
    assert len([e for e in done.heard if isinstance(e, StepEnded)]) == len(done.plan.steps)
    asked = " ".join(ask.question for ask in done.asked if ask.key == "by_hand")
    assert "set the exposure time from 1/160 s to 1/50 s" in asked
    assert "add light on that side" in asked
    assert "Turn the chart counter-clockwise by 6." in asked
    assert "focus ring" in asked
    assert abs(done.view.mount.roll_deg) < 1
    # yaw and pitch were corrected by moving around the chart
    assert done.state.facts["at_pan_deg"] == pytest.approx(done.view.mount.yaw_deg, abs=1.5)
    assert done.state.facts["at_tilt_deg"] == pytest.approx(done.view.mount.pitch_deg, abs=1.5)
    assert done.state.facts["laser_offset_mm"] == pytest.approx(120.0, abs=15)
    curve = [event for event in done.heard if isinstance(event, ScanEvent)][-1]
    assert len(curve.scores) == 5
    assert done.state.facts["focus_mtf50"] == max(curve.scores)


def test_the_psf_is_the_camera_s(done, again):
    (result,) = (event for event in done.heard if isinstance(event, Result))
    assert result.verdict is Verdict.PASS
    found = again.computed.planes["G1"].estimate
    assert found.chance > 1e-4
    taken, psf = done.view.taken[-1], found.shots[0].psf
    true = taken.true_psf("G1", psf.s, psf.k)
    # error over expected error: 1 where the error bars are true; the norm of 289 correlated values scatters by a third
    assert compare(found.shots[0], true.h, true.floor, partial(taken.true_otf, "G1")).ratio < 1.6
    # the blur of the print, which all photographs share, is the larger part
    mean, one = (each.quality.budgets["mtf50_horizontal"] for each in (found, found.shots[0]))
    assert mean["noise"] < one["noise"]
    # the target is of what more photographs lower: not of what all of them share, such as the blur of the print
    budgets = [found.quality.budgets[f"mtf50_{way}"] for way in ("horizontal", "vertical")]
    assert max(combined({t: u for t, u in one.items() if t not in COMMON}) for one in budgets) <= 0.002


def test_every_photograph_has_the_state_of_the_devices_and_the_rooms_temperature(done):
    assert len(done.state.counting()) >= 3
    for shot in done.state.shots:
        assert read_frame(done.folder / shot.path, ["G1"]).sha256 == shot.sha256
        assert {"z_mm", "pan_deg"} <= set(shot.snapshot["axes"])
        assert "acceleration_m_s2" in shot.snapshot
    assert all(shot.counts is not None for shot in done.state.shots)
    readings = [shot.snapshot["environment"]["room"]["temperature"]["value"] for shot in done.state.counting()]
    kept = read_record(done.folder / done.state.results[-1].folder)["environment"]["room"]
    assert kept["temperature"]["min"] == min(readings)
    assert kept["temperature"]["n"] == len(readings)
    # the room warms up from 21 by 3 kelvin, and swings by 0.3; the probe states 0.1
    assert 20.7 <= min(readings) <= max(readings) <= 24.3
    assert (kept["temperature"]["uncertainty"], kept["humidity"]["unit"]) == (0.1, "%")
    page = done.ends[1].report.read_text()
    assert "temperature (room)" in page
    assert "humidity (room)" in page
