"""The guide, driven by keys, with runs that are scripts."""

import threading
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.errors import BadConfiguration, MoveFailed
from procedures.pattern_psf.gamma import gamma_diagram
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import Ask
from station.app.app import StationApp
from station.drawing.glyphs import ASCII, UNICODE
from station.guide.frontend import DiagramEvent, ProblemEvent, ProgressEvent, RunEnded, ScanEvent, Stopped
from station.guide.scripted import ScriptedOperator
from station.guide.workspace import OpenedBench, SessionSummary, StationLab
from station.sessions.reader import read_session

from .driving import BEGIN, Absent, Driver, play
from .fakes import STEPS, FakeLab, FakeRun, chosen_step, doing, seen

WIDTH = Ask("width", "How wide is the chart?", "number", unit="mm", low=50, high=2000, default=300.0)
MOVED = Ask("moved", "Move the camera back 0.42 m.")
VERDICT = Ask("verdict", "Accept the result?", "choice", default="accept", choices=("accept", "retake"))
BOTH = pytest.mark.parametrize("size", [(80, 24), (120, 40)], ids=["80x24", "120x40"])


def whole(run: FakeRun) -> RunEnded:
    run.answers = [
        *run.step("print", WIDTH),
        *run.step("distance", seen(), MOVED),
        *run.step("focus", ScanEvent("z_mm", (0.0, 1.0, 2.0), (0.2, 0.5, 0.3)), VERDICT),
        *run.step("shots"),
    ]
    return RunEnded("finished", Path("sessions/one/report.html"))


@pytest.mark.slow
@BOTH
def test_enter_alone_leads_to_the_report_and_the_rail_shows_what_each_step_gave(tmp_path, size):
    lab = FakeLab(tmp_path, whole)
    steps = BEGIN, WIDTH, "Print 300 mm", MOVED, "Distance s/t 1.28", VERDICT, "sessions/one/report.html"
    play(StationApp(lab), *steps, ["enter"], "There is no result yet", size=size)
    assert lab.begun == [("pattern", "my camera", "my lens")]
    assert lab.runs[0].answers == [300.0, True, "accept"]


@pytest.mark.parametrize(("size", "glyphs"), [((80, 24), UNICODE), ((120, 40), UNICODE), ((80, 24), ASCII)], ids=str)
def test_the_screen_shows_a_drawing_then_steps_numbers_picture_devices_and_what_to_do(tmp_path, size, glyphs):
    name = f"{size[0]}-{'ascii' if glyphs.ascii else 'unicode'}"
    drawing, guide = (lambda driver, kind=kind: driver.looks_like(f"{kind}-{name}") for kind in ("drawing", "guide"))
    app = StationApp(FakeLab(tmp_path, whole), glyphs)
    play(app, BEGIN, WIDTH.question, drawing, ["enter"], MOVED.question, guide, size=size)


@BOTH
def test_a_curve_is_never_shown_with_half_a_drawing(tmp_path, size):
    diagram = gamma_diagram(ImagingGeometry(24.0, 11.88, 0.3), 4, 17, 1.3)
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, DiagramEvent(diagram), MOVED))
    drawn = [one if size[0] > 80 else Absent(one) for one in ("measure this ruler", "#:.#")]
    play(StationApp(lab), BEGIN, MOVED.question, "gamma over", *drawn, size=size)


@pytest.mark.slow
def test_without_colours_the_screen_is_ascii(tmp_path, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    app = StationApp(FakeLab(tmp_path, whole))
    assert app.glyphs is ASCII

    def ascii_alone(driver: Driver) -> bool:
        return driver.text.isascii()

    ended = "report.html", ["enter"], "There is no result yet"
    play(app, BEGIN, WIDTH, MOVED, VERDICT.question, ascii_alone, ["enter"], *ended)


@pytest.mark.slow
def test_a_number_outside_its_limits_is_asked_for_again(tmp_path):
    again = ["end", *["backspace"] * 3, "7", "enter"], "between 50 and 2000 mm", ["backspace", *"200", "enter"]
    play(StationApp(FakeLab(tmp_path, whole)), BEGIN, WIDTH.question, *again, MOVED.question)


def test_a_choice_is_taken_by_its_number(tmp_path):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, VERDICT))
    play(StationApp(lab), BEGIN, "2\N{NO-BREAK SPACE}retake", ["2"], lambda driver: lab.runs[0].answers == ["retake"])


def test_trouble_says_what_happened_and_what_to_do(tmp_path):
    trouble = ProblemEvent("the stage did not answer", "check its cable")
    ask = Ask("trouble", "What now?", "choice", default="try again", choices=("try again", "skip", "stop"))
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, trouble, ask))
    play(StationApp(lab), BEGIN, "the stage did not answer. Check its cable.", "try again")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MoveFailed("z_mm stands at 3 mm, was sent to 9", "free the rail"), "z_mm stands at 3 mm"),
        (ZeroDivisionError("division by zero"), "ZeroDivisionError"),
    ],
)
def test_what_breaks_a_run_is_a_sentence(tmp_path, error, words):
    def broken(run: FakeRun) -> RunEnded:
        raise error

    play(StationApp(FakeLab(tmp_path, broken)), BEGIN, words, "All photographs are kept", Absent("Traceback"))


def patient(run: FakeRun) -> RunEnded:
    """Exposes until asked to stop, then ends the current exposure on request."""
    run.step("print", doing("exposing"))
    run.asked.wait(20)
    run.may_end.wait(20)
    raise Stopped


def end_exposure(driver: Driver) -> bool:
    driver.app.lab.runs[-1].may_end.set()
    return True


def test_work_is_ended_after_this_exposure_then_gone_on_with(tmp_path):
    lab, kept = FakeLab(tmp_path, patient), "continue where it stopped"
    first = ["ctrl+c"], "Ending after this exposure", lambda driver: not lab.runs[0].halted.is_set(), end_exposure, kept
    again = ["enter"], lambda driver: len(lab.runs) == 2, end_exposure, ["ctrl+c"], kept
    play(StationApp(lab), BEGIN, "2 of 5", "about 1", *first, *again)  # seconds left of 12
    assert lab.begun[1] == (tmp_path / "one", None)
    assert lab.stage.stops == 0


def test_pressed_twice_it_ends_now(tmp_path):
    lab = FakeLab(tmp_path, patient)

    def stopped(driver: Driver) -> bool:
        return lab.runs[0].halted.is_set() and lab.stage.stops > 0

    play(StationApp(lab), BEGIN, "exposing", ["ctrl+c", "ctrl+c"], stopped, end_exposure, "Every device was stopped")


def test_ending_at_a_question_ends_at_once(tmp_path):
    lab = FakeLab(tmp_path, whole)
    play(StationApp(lab), BEGIN, WIDTH.question, ["ctrl+c"], "continue where it stopped")


def test_taking_the_shots_again_shows_what_is_to_do_again(tmp_path):
    def again(run: FakeRun) -> RunEnded:
        for name in STEPS:
            run.step(name)
        run.step("focus", WIDTH)
        return RunEnded("finished")

    counts = [lambda driver, one=one: driver.text.count(one[0]) == one[1] for one in (("✓", 2), ("to do", 1))]
    play(StationApp(FakeLab(tmp_path, again)), BEGIN, WIDTH.question, *counts)


@pytest.mark.parametrize(
    ("reason", "remedy"),
    [
        ("there is no station.toml", "write one, or use --simulate"),
        ("no port is free on this computer", "end another simulated bench"),
    ],
)
def test_a_bench_that_cannot_be_opened_is_a_sentence_and_no_other_advice(tmp_path, reason, remedy):
    lab = FakeLab(tmp_path, whole)

    def missing() -> OpenedBench:
        raise BadConfiguration(reason, remedy)

    lab.open = missing  # type: ignore[method-assign]
    advice = () if "--simulate" in remedy else (Absent("--simulate"),)
    said = reason, "the bench could not be opened", ["f3"], f"{reason}. {remedy}.", *advice
    play(StationApp(lab), *said, size=(120, 40))


def test_stepping_back_opens_the_step_before_again(tmp_path):
    lab = FakeLab(tmp_path, whole)
    play(StationApp(lab), BEGIN, WIDTH, MOVED.question, ["f6"], lambda driver: len(lab.runs) == 2)
    assert lab.begun[1] == (tmp_path / "one", "print")


def test_an_old_session_is_continued_from_the_first_screen(tmp_path):
    kept = SessionSummary(
        tmp_path / "old", "pattern", "D90", "50 mm", "2026-03-14T09:26:53", ("print", "distance"), None
    )
    lab = FakeLab(tmp_path, whole, [replace(kept, folder=tmp_path / "new", ended="finished"), kept])
    # camera and lens of the last session are proposed
    play(StationApp(lab), "2 steps done", "50 mm", ["down", "down", "enter"], lambda driver: lab.begun)
    assert lab.begun == [(tmp_path / "old", None)]


@pytest.mark.slow
def test_a_question_is_announced_on_other_screens(tmp_path):
    go = threading.Event()

    def late(run: FakeRun) -> RunEnded:
        go.wait(20)
        return chosen_step(run, WIDTH)

    announced = go, "The guide (F2) asks", ["f2", "enter"], "new session"
    play(StationApp(FakeLab(tmp_path, late)), BEGIN, "Opening the session", ["f3"], "Manual moves", *announced)


def test_a_run_with_more_events_than_can_be_shown_loses_no_step(tmp_path):
    def hasty(run: FakeRun) -> RunEnded:
        for name in STEPS:
            run.step(name, *(ProgressEvent(f"frame {i}", i, 300) for i in range(300)), seen(True))
        return RunEnded("finished")

    steps = [f"✓ {name.capitalize()}" for name in STEPS]
    play(StationApp(FakeLab(tmp_path, hasty)), BEGIN, "new session", *steps)


@pytest.mark.slow
@BOTH
def test_a_curve_that_explains_is_shown_with_its_sentence_and_leaves_room_for_the_question(tmp_path, size):
    diagram = gamma_diagram(ImagingGeometry(50.0, 8.0, 0.9375), 4, 17, 1.3)
    lab = FakeLab(tmp_path, lambda run: run.step("distance", DiagramEvent(diagram), MOVED) and RunEnded("stopped"))
    said = "At s/t 1.3 (18.08 m) the noise amplification", "(12.39"
    play(StationApp(lab), BEGIN, MOVED.question, *said, size=size)


@pytest.mark.slow
def test_a_session_that_began_with_a_shaker_goes_on_with_one_and_others_do_not(tmp_path):
    began = StationLab(sessions=tmp_path / "sessions", config=None, simulate=True, shaker=True)
    began.begin("restoration", "D90", "50 mm", ScriptedOperator({"scene": stopping})).go()
    began.close()
    lab = StationLab(sessions=began.sessions, config=None, simulate=True)
    stop = ["ctrl+c"], "continue where it stopped"
    play(StationApp(lab), "Or continue a session", ["tab", "enter"], "The shaker makes", *stop)
    lines = read_session(lab.kept()[0].folder).contents.lines
    assert ["shaker" in line.data["devices"] for line in lines if line.event == "devices"] == [True, True]
    lab.begin("restoration", "D90", "50 mm", ScriptedOperator({"blur_by": stopping})).go()
    assert "shaker" not in lab.open().bench.devices
    lab.close()


def stopping(ask: Ask) -> bool:
    raise Stopped
