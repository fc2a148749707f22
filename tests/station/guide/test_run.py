"""A run carries out its plan, stores everything, and turns every error into a message and a question."""

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import FrameMissing
from drivers.light import LampProperties
from procedures.outcome import BadParameter
from procedures.plan import Advice, Ask, Go, Look, Shoot
from simulators.bench.bench import FaultEvent
from station.guide.frontend import (
    LAMP,
    FrameEvent,
    ProblemEvent,
    ProgressEvent,
    RunBegan,
    RunEnded,
    ScanEvent,
    StepBegan,
    StepEnded,
    Stopped,
)
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.guide.vibration import SettlingTimeouts
from station.guide.workspace import StationLab
from station.sessions.reader import read_session
from station.sessions.session import Session

from . import benches


def events(operator, kind):
    return [event for event in operator.heard if isinstance(event, kind)]


def test_a_plan_is_carried_out_step_by_step_and_all_photographs_are_kept(bench, session):
    operator = ScriptedOperator({"width": 5.0})
    assert Run(benches.short_plan(), bench, session, operator).go() == RunEnded("finished")
    assert isinstance(operator.heard[0], RunBegan)
    assert [event.step.name for event in events(operator, StepEnded)] == ["rig", "trials", "shots"]
    state = session.state
    assert state.done == ("rig", "trials", "shots")
    assert state.ended == "finished"
    assert state.facts["width"] == 5.0
    assert [(shot.purpose, shot.counts) for shot in state.shots] == [
        ("trial", False), ("scan", False), ("scan", False), ("scan", False), ("shot", True), ("shot", True),
    ]  # fmt: skip
    assert len(events(operator, FrameEvent)) == 6
    assert len(list(Path(bench.simulated.folder).iterdir())) == 6


def test_exposures_too_short_for_the_lamps_modulation_are_reported_once(bench, session):
    bench.light.panel = LampProperties(pwm_hz=1000.0)
    operator = ScriptedOperator({"width": 5.0})
    Run(benches.short_plan(), bench, session, operator).go()
    reported = [event for event in events(operator, ProblemEvent) if "periods of the lamp's modulation" in event.reason]
    assert [event.remedy for event in reported] == ["expose longer, or use a lamp without modulation"]


def test_a_lamp_that_cannot_be_switched_off_at_the_end_is_reported(bench, session, capsys):
    def enough(results, facts):
        bench.simulated.cables["light"].faults.spoil_reply = lambda data, at_s: b""
        return Advice(True, "enough")

    operator = ScriptedOperator({"width": 5.0})
    Run(
        benches.short_plan(shoot=Shoot("shot", benches.good, benches.passed, enough, most=1)), bench, session, operator
    ).go()
    reported = [event for event in events(operator, ProblemEvent) if "lamp" in event.reason]
    assert [event.remedy for event in reported] == ["switch it off by hand"]
    bench.close()
    assert "warning: the lamp may still be lit" in capsys.readouterr().err


def test_a_stop_that_a_line_does_not_take_is_reported(bench, session):
    def enough(results, facts):
        bench.simulated.cables["stage"].faults.unplugged_at_s = 0.0
        run.stop_now()
        return Advice(True, "enough")

    operator = ScriptedOperator({"width": 5.0})
    plan = benches.short_plan(shoot=Shoot("shot", benches.good, benches.passed, enough, most=1))
    run = Run(plan, bench, session, operator)
    assert run.go().how == "emergency"
    reported = [event for event in events(operator, ProblemEvent) if "could not be sent" in event.reason]
    assert [event.reason for event in reported] == ["the stop could not be sent to stage"]


def test_a_plan_without_movements_accepts_stages_that_have_not_homed(bench, session):
    operator = ScriptedOperator({"width": 5.0})
    still = {name: Ask(name, "Ready?") for name in ("home", "go", "measure", "scan")}
    assert Run(benches.short_plan(**still), bench, session, operator).go().how == "finished"
    assert not events(operator, ProblemEvent)


def test_a_skipped_step_asks_nothing(bench, session):
    plan = benches.short_plan()
    first, *others = plan.steps
    operator = ScriptedOperator({"width": 5.0})
    Run(replace(plan, steps=(replace(first, when=lambda facts: False), *others)), bench, session, operator).go()
    assert "width" not in session.state.facts
    assert [event.step.name for event in events(operator, StepBegan)] == ["trials", "shots"]
    assert session.state.done == ("rig", "trials", "shots")


def test_the_bench_goes_where_the_plan_and_the_scan_say(bench, session):
    operator = ScriptedOperator()
    Run(benches.short_plan(), bench, session, operator).go()
    curve = events(operator, ScanEvent)[-1]
    # best of 600, 620, 640 is the one nearest to 615
    assert curve.scores == pytest.approx((-15.0, -5.0, -25.0), abs=0.1)
    assert bench.stage.position()["z_mm"] == pytest.approx(620.0, abs=0.02)
    assert session.state.facts["light_level"] == pytest.approx(0.8)
    assert bench.light.level() == 0.0, "the lamp goes out at the end"
    assert [ask.key for ask in operator.asked].count(LAMP) == 1, "it asks once, before it is lit"
    assert session.state.facts["distance_mm"] == pytest.approx(800.0 + 700.0 + 120.0, abs=3)


def test_shots_store_the_state_of_the_settled_devices(bench, session):
    Run(benches.short_plan(), bench, session, ScriptedOperator()).go()
    shot = session.state.counting()[0]
    assert shot.snapshot["axes"]["z_mm"] == pytest.approx(620.0, abs=0.02)
    assert shot.snapshot["light_level"] == pytest.approx(0.8)
    assert 0 < shot.snapshot["acceleration_m_s2"] < 0.1
    assert shot.exposure["shutter"]["closed_s"] > 0
    world = bench.simulated.world
    for opening in bench.simulated.body.openings:
        sway = world.sway(np.array([opening.begin_s - 0.01]))
        # a tenth of a pixel of the bench's camera at 1.4 m is 40 um of pan's arm, 0.0017 deg
        assert abs(sway["pan_deg"][0][0]) < 0.0017
        assert abs(sway["z_mm"][0][0]) < 0.05


@pytest.mark.slow
def test_a_look_corrects_with_the_bench_where_possible(bench, session):
    def nearer(frame, facts):
        off = 900.0 - facts["at_z_mm"]
        return Advice(abs(off) < 1, f"move by {off:.0f} mm", moves={"z_mm": off})

    operator = ScriptedOperator()
    Run(benches.short_plan(look=Look("trial", nearer)), bench, session, operator).go()
    assert not [ask for ask in operator.asked if ask.key == "by_hand"]
    assert session.state.facts["low_z_mm"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("moves", "why"), [({"z_mm": 5000.0}, "its travel is 0 to 1500"), ({"lens_mm": 1.0}, "")])
def test_other_corrections_are_requested_from_the_operator(bench, session, moves, why):
    looks = []

    def far(frame, facts):
        looks.append(1)
        return Advice(len(looks) > 1, "Move it.", moves=moves)

    operator = ScriptedOperator()
    Run(benches.short_plan(look=Look("trial", far)), bench, session, operator).go()
    (ask,) = [ask for ask in operator.asked if ask.key == "by_hand"]
    assert ask.question.startswith("Move it.")
    assert why in ask.question
    name, change = next(iter(moves.items()))
    assert session.state.facts[f"hand_{name}"] == change


@pytest.mark.slow
def test_a_camera_that_takes_its_settings_through_its_cable_is_not_set_by_hand(bench, session):
    looks, wanted = [], []

    def dark(frame, facts):
        looks.append(1)
        return Advice(len(looks) > 1, "Expose longer.", by_hand={"exposure_ev": 1.0})

    bench.drivers = {**bench.drivers, "camera": "gphoto"}
    bench.devices["camera"].configure = wanted.append
    operator = ScriptedOperator()
    Run(benches.short_plan(look=Look("trial", dark)), bench, session, operator).go()
    assert [settings.exposure_s for settings in wanted] == [pytest.approx(0.04)]
    assert "by_hand" not in [ask.key for ask in operator.asked]


@pytest.mark.slow
def test_after_some_looks_the_operator_decides(bench, session):
    never = Look("trial", lambda frame, facts: Advice(False, "Not yet."), tries=2)
    answers = iter(["look again", "go on"])
    operator = ScriptedOperator({"look": lambda ask: next(answers)})
    assert Run(benches.short_plan(look=never), bench, session, operator).go().how == "finished"
    assert sum(shot.purpose == "trial" for shot in session.state.shots) == 4


@pytest.mark.slow
def test_asking_to_stop_ends_after_this_exposure_and_the_session_goes_on_later(bench, session, tmp_path):
    def listen(event):
        if isinstance(event, ProgressEvent) and event.say == "exposing" and len(session.state.shots) == 4:
            run.ask_to_stop()

    run = Run(benches.short_plan(), bench, session, ScriptedOperator(listen=listen))
    assert run.go().how == "stopped"
    assert session.state.done == ("rig", "trials")
    taken = len(session.state.shots)
    assert taken == 5  # the exposure that was under way is kept
    session.close()
    with Session.open(session.folder, bench.clock) as again:
        operator = ScriptedOperator()
        assert Run(benches.short_plan(), bench, again, operator).go().how == "finished"
        assert events(operator, RunBegan)[0].done == ("rig", "trials")
        assert len(again.state.shots) == taken + 1
        assert bench.stage.position()["z_mm"] == pytest.approx(620.0, abs=0.02)  # homed, and back


def test_the_emergency_stop_ends_the_run_at_once(bench, session):
    def listen(event):
        if isinstance(event, ProgressEvent) and event.say == "going to 700 mm":
            run.stop_now()

    run = Run(benches.short_plan(), bench, session, ScriptedOperator(listen=listen))
    assert run.go().how == "emergency"
    assert session.state.ended == "emergency"
    assert not bench.simulated.body.openings
    (halted,) = halts(session)
    # the simulated devices share the clock: a command is on the wire at its time or later
    assert all(at_s >= halted["asked_s"] for at_s in halted["on_the_wire_s"].values())
    assert {"stage", "head", "shutter"} <= set(halted["on_the_wire_s"])


def halts(session):
    return [line.data for line in read_session(session.folder).contents.lines if line.event == "halted"]


@pytest.mark.parametrize("fault", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_an_unexpected_exit_stops_the_bench_and_ends_the_session(bench, session, fault):
    def listen(event):
        if isinstance(event, ProgressEvent) and event.say == "going to 700 mm":
            raise fault

    with pytest.raises(fault):
        Run(benches.short_plan(), bench, session, ScriptedOperator(listen=listen)).go()
    assert session.state.ended == "emergency"
    assert len(halts(session)) == 1


@pytest.mark.slow
def test_an_open_door_is_reported_and_a_retry_after_closing_it_continues(bench, session):
    twin, cable = bench.simulated.devices["stage"], bench.simulated.cables["stage"]

    def listen(event):
        if isinstance(event, ProgressEvent) and event.say == "going to 700 mm":
            cable.happen(lambda now_s: twin.door(True, now_s))

    def close_and_try_again(ask):
        cable.happen(lambda now_s: twin.door(False, now_s))
        return "try again"

    operator = ScriptedOperator({"trouble": close_and_try_again}, listen=listen)
    assert Run(benches.short_plan(), bench, session, operator).go().how == "finished"
    (trouble,) = events(operator, ProblemEvent)
    assert "is paused at the door" in trouble.reason
    assert trouble.remedy == "close it and resume"


@pytest.mark.slow
def test_motors_that_release_are_reported_before_anything_moves(bench, session):
    bench.simulated.devices["stage"].settings[1] = 25
    operator = ScriptedOperator()
    assert Run(benches.short_plan(), bench, session, operator).go().how == "finished"
    (trouble,) = events(operator, ProblemEvent)
    assert "the motors let go 25 ms after each move" in trouble.reason
    lines = [line.event for line in read_session(session.folder).contents.lines]
    assert lines.index("caveat") < lines.index("step_began")


def test_an_operator_who_stops_at_a_question_stops_the_run(bench, session):
    def stop(ask):
        raise Stopped

    operator = ScriptedOperator({"width": stop})
    assert Run(benches.short_plan(), bench, session, operator).go().how == "stopped"


@contextmanager
def finished_run(folder, fault):
    """A finished run with a fault: bench, session and operator."""
    with benches.quick_bench(folder, fault_events=[fault]) as bench, benches.new_session(folder, bench) as session:
        operator = ScriptedOperator()
        assert Run(benches.short_plan(), bench, session, operator).go().how == "finished"
        yield bench, session, operator


def test_a_lost_frame_is_reported_and_taken_again(tmp_path):
    with finished_run(tmp_path, FaultEvent(1.0, "lose_frame", 1)) as (bench, session, operator):
        (trouble,) = events(operator, ProblemEvent)
        assert "no complete RAW file" in trouble.reason
        assert len(session.state.shots) == 6
        assert len(bench.simulated.body.openings) == 7


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "moment_s"), [("alarm", 19.0), ("reset", 19.0), ("reset", 40.0), ("stall", 19.0)])
def test_a_rail_that_lost_its_position_is_reported_and_homed_again(tmp_path, kind, moment_s):
    with finished_run(tmp_path, FaultEvent(moment_s, kind, 1)) as (bench, _, operator):
        assert events(operator, ProblemEvent) or kind == "stall"  # the head, which this plan does not move
        assert bench.stage.position()["z_mm"] == pytest.approx(620.0, abs=0.02)
        there = bench.simulated.world.axes["z_mm"].position(bench.clock.now_s())
        assert there == pytest.approx(620.0, abs=0.02)  # the true position, not the controller's


@pytest.mark.slow
def test_the_run_continues_without_a_skipped_device(bench, session):
    operator = ScriptedOperator({"trouble": "skip"})
    beyond = Go(lambda facts: {"z_mm": 9999.0}, lambda facts: "going too far")
    run = Run(benches.short_plan(go=beyond), bench, session, operator)
    assert run.go().how == "finished"


def test_the_run_continues_without_a_silent_imu(bench, session):
    bench.devices["imu"].start = lambda rate_hz: (_ for _ in ()).throw(FrameMissing("no samples", "check its cable"))
    operator = ScriptedOperator()
    assert Run(benches.short_plan(), bench, session, operator).go().how == "finished"
    assert [trouble.reason for trouble in events(operator, ProblemEvent)] == ["no samples"]


def test_without_a_bench_photographs_come_from_a_folder(tmp_path, bench):
    frames = tmp_path / "card"
    frames.mkdir()
    count = iter(range(1, 100))

    def photograph(ask: Ask):
        number = next(count)
        if number == 2:
            return True  # the file has not come yet
        (frames / f"DSC_{number}.dng").write_bytes(benches.frame_bytes(number))
        return True

    operator = ScriptedOperator({"frames_folder": str(frames), "photographed": photograph})
    with benches.new_session(tmp_path, bench) as session:
        assert Run(benches.short_plan(), None, session, operator, SettlingTimeouts(quiet=1.0)).go().how == "finished"
        assert len(session.state.shots) == 6
    (trouble,) = events(operator, ProblemEvent)
    assert "no new photograph" in trouble.reason


def test_a_wrong_folder_of_photographs_is_corrected_within_the_run(tmp_path, bench):
    right, wrong = tmp_path / "right", tmp_path / "wrong"
    for folder in (right, wrong):
        folder.mkdir()
    (right / "old.dng").write_bytes(benches.frame_bytes(50))  # an older file is not the new photograph
    count = iter(range(1, 100))

    def photograph(ask: Ask):
        (right / f"DSC_{next(count)}.dng").write_bytes(benches.frame_bytes(next(count)))
        return True

    named = iter([str(tmp_path / "nowhere"), str(wrong), str(right)])
    operator = ScriptedOperator({"frames_folder": lambda ask: next(named), "photographed": photograph})
    with benches.new_session(tmp_path, bench) as session:
        assert Run(benches.short_plan(), None, session, operator, SettlingTimeouts(quiet=1.0)).go().how == "finished"
        assert session.state.facts["frames_folder"] == str(right)
        assert not any(Path(str(shot.exposure["path"])).name == "old.dng" for shot in session.state.shots)
    assert ["there is no folder" in one.reason for one in events(operator, ProblemEvent)] == [True, False]


def test_a_second_run_cannot_use_the_bench(tmp_path):
    lab = StationLab(sessions=tmp_path / "sessions", config=None)
    first = lab.begin("pattern", "C", "L", ScriptedOperator({"paper": stopping}))
    with pytest.raises(BadParameter, match="in use by another run"):
        lab.begin("pattern", "C", "L", ScriptedOperator())
    assert first.go().how == "stopped"
    lab.begin("pattern", "C", "L", ScriptedOperator({"paper": stopping})).go()
    lab.close()
    assert list((tmp_path / "sessions").iterdir()) == []  # nothing was answered in either


def stopping(ask: Ask):
    raise Stopped


def test_a_finished_session_of_a_plan_without_a_step_is_not_restarted(bench, session):
    plan = benches.short_plan()
    Run(plan, bench, session, ScriptedOperator({"width": 5.0})).go()
    first, *others = plan.steps
    between = replace(first, name="between", when=lambda facts: False)
    operator = ScriptedOperator()
    assert Run(replace(plan, steps=(first, between, *others)), bench, session, operator).go().how == "finished"
    assert "between" not in session.state.done
    assert not operator.asked
