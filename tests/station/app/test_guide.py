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

from .driving import Driver, drive
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
def test_enter_alone_leads_from_the_first_screen_to_the_report(tmp_path, size):
    lab = FakeLab(tmp_path, whole)

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.answer(WIDTH.question, MOVED.question, VERDICT.question)
        await driver.until("sessions/one/report.html")
        await driver.press("enter")
        await driver.until("There is no result yet")

    drive(StationApp(lab), use, size)
    assert lab.begun == [("pattern", "my camera", "my lens")]
    assert lab.runs[0].answers == [300.0, True, "accept"]


@pytest.mark.parametrize(("size", "glyphs"), [((80, 24), UNICODE), ((120, 40), UNICODE), ((80, 24), ASCII)], ids=str)
def test_the_screen_shows_steps_numbers_picture_devices_and_what_to_do(tmp_path, size, glyphs):
    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.answer(WIDTH.question)
        await driver.until(MOVED.question)
        await driver.looks_like(f"guide-{size[0]}-{'ascii' if glyphs.ascii else 'unicode'}")

    drive(StationApp(FakeLab(tmp_path, whole), glyphs), use, size)


@pytest.mark.parametrize(("size", "glyphs"), [((80, 24), UNICODE), ((120, 40), UNICODE), ((80, 24), ASCII)], ids=str)
def test_before_the_first_photograph_a_drawing_shows_what_to_do(tmp_path, size, glyphs):
    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(WIDTH.question)
        await driver.looks_like(f"drawing-{size[0]}-{'ascii' if glyphs.ascii else 'unicode'}")

    drive(StationApp(FakeLab(tmp_path, whole), glyphs), use, size)


@BOTH
def test_a_curve_is_never_shown_with_half_a_drawing(tmp_path, size):
    diagram = gamma_diagram(ImagingGeometry(24.0, 11.88, 0.3), 4, 17, 1.3)
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, DiagramEvent(diagram), MOVED))

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(MOVED.question)
        await driver.until("gamma over")
        assert ("measure this ruler" in driver.text) == (size[0] > 80)
        assert ("#:.#" in driver.text) == (size[0] > 80)

    drive(StationApp(lab), use, size)


@pytest.mark.slow
def test_the_rail_shows_what_each_step_gave(tmp_path):
    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.answer(WIDTH.question)
        await driver.until("Print 300 mm")
        await driver.answer(MOVED.question)
        await driver.until("Distance s/t 1.28")

    drive(StationApp(FakeLab(tmp_path, whole)), use)


@pytest.mark.slow
def test_the_guide_works_without_colours(tmp_path, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.answer(WIDTH.question, MOVED.question, VERDICT.question)
        await driver.until("report.html")
        await driver.press("enter")
        await driver.until("There is no result yet")

    app = StationApp(FakeLab(tmp_path, whole))
    assert app.glyphs is ASCII
    drive(app, use)


def test_an_ascii_screen_has_nothing_but_ascii(tmp_path):
    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.answer(WIDTH.question)
        await driver.answer(MOVED.question)
        await driver.until(VERDICT.question)
        assert driver.text.replace("\N{NO-BREAK SPACE}", " ").isascii(), driver.text

    drive(StationApp(FakeLab(tmp_path, whole), ASCII), use)


@pytest.mark.slow
def test_a_number_outside_its_limits_is_asked_for_again(tmp_path):
    lab = FakeLab(tmp_path, whole)

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(WIDTH.question)
        await driver.press("end", *["backspace"] * 3, "7", "enter")
        await driver.until("between 50 and 2000 mm")
        await driver.press("backspace", *"200", "enter")
        await driver.until(MOVED.question)

    drive(StationApp(lab), use)


def test_a_choice_is_taken_by_its_number(tmp_path):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, VERDICT))

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until("2\N{NO-BREAK SPACE}retake")
        await driver.press("2")
        await driver.until(lambda: lab.runs[0].answers)

    drive(StationApp(lab), use)
    assert lab.runs[0].answers == ["retake"]


def test_trouble_says_what_happened_and_what_to_do(tmp_path):
    trouble = ProblemEvent("the stage did not answer", "check its cable")
    ask = Ask("trouble", "What now?", "choice", default="try again", choices=("try again", "skip", "stop"))

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until("the stage did not answer. Check its cable.")
        await driver.until("try again")

    drive(StationApp(FakeLab(tmp_path, lambda run: run.step("print", trouble, ask) and RunEnded("finished"))), use)


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

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(words)
        await driver.until("All photographs are kept")
        assert "Traceback" not in driver.text

    drive(StationApp(FakeLab(tmp_path, broken)), use)


def patient(run: FakeRun) -> RunEnded:
    """Exposes until asked to stop, then ends the current exposure on request."""
    run.step("print", doing("exposing"))
    run.asked.wait(20)
    run.may_end.wait(20)
    raise Stopped


def test_work_is_ended_after_this_exposure_then_gone_on_with(tmp_path):
    lab = FakeLab(tmp_path, patient)

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until("2 of 5")
        await driver.until("about 1")  # seconds left of 12
        await driver.press("ctrl+c")
        await driver.until("Ending after this exposure")
        assert not lab.runs[0].halted.is_set()
        lab.runs[0].may_end.set()
        await driver.until("continue where it stopped")
        await driver.press("enter")
        await driver.until(lambda: len(lab.runs) == 2)
        lab.runs[1].may_end.set()
        await driver.press("ctrl+c")
        await driver.until("continue where it stopped")

    drive(StationApp(lab), use)
    assert lab.begun[1] == (tmp_path / "one", None)
    assert lab.stage.stops == 0


def test_pressed_twice_it_ends_now(tmp_path):
    lab = FakeLab(tmp_path, patient)

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until("exposing")
        await driver.press("ctrl+c", "ctrl+c")
        await driver.until(lambda: lab.runs[0].halted.is_set() and lab.stage.stops)
        lab.runs[0].may_end.set()
        await driver.until("Every device was stopped")

    drive(StationApp(lab), use)


def test_ending_at_a_question_ends_at_once(tmp_path):
    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(WIDTH.question)
        await driver.press("ctrl+c")
        await driver.until("continue where it stopped")

    drive(StationApp(FakeLab(tmp_path, whole)), use)


def test_taking_the_shots_again_shows_what_is_to_do_again(tmp_path):
    def again(run: FakeRun) -> RunEnded:
        for name in STEPS:
            run.step(name)
        run.step("focus", WIDTH)
        return RunEnded("finished")

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(WIDTH.question)
        assert driver.text.count("✓") == 2
        assert driver.text.count("to do") == 1

    drive(StationApp(FakeLab(tmp_path, again)), use)


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

    async def use(driver: Driver) -> None:
        await driver.until(reason)
        await driver.until("the bench could not be opened")
        await driver.press("f3")
        await driver.until(f"{reason}. {remedy}.")
        assert ("--simulate" in driver.text) == ("--simulate" in remedy)

    drive(StationApp(lab), use, (120, 40))


def test_stepping_back_opens_the_step_before_again(tmp_path):
    lab = FakeLab(tmp_path, whole)

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.answer(WIDTH.question)
        await driver.until(MOVED.question)
        await driver.press("f6")
        await driver.until(lambda: len(lab.runs) == 2)

    drive(StationApp(lab), use)
    assert lab.begun[1] == (tmp_path / "one", "print")


def test_an_old_session_is_continued_from_the_first_screen(tmp_path):
    kept = SessionSummary(
        tmp_path / "old", "pattern", "D90", "50 mm", "2026-03-14T09:26:53", ("print", "distance"), None
    )
    lab = FakeLab(tmp_path, whole, [replace(kept, folder=tmp_path / "new", ended="finished"), kept])

    async def use(driver: Driver) -> None:
        await driver.until("2 steps done")
        await driver.until("50 mm")  # camera and lens of the last session are proposed
        await driver.press("down", "down", "enter")
        await driver.until(lambda: lab.begun)

    drive(StationApp(lab), use)
    assert lab.begun == [(tmp_path / "old", None)]


@pytest.mark.slow
def test_a_question_is_announced_on_other_screens(tmp_path):
    go = threading.Event()

    def late(run: FakeRun) -> RunEnded:
        go.wait(20)
        return chosen_step(run, WIDTH)

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until("Opening the session")
        await driver.press("f3")
        await driver.until("Manual moves")
        go.set()
        await driver.until("The guide (F2) asks")
        await driver.press("f2", "enter")
        await driver.until("new session")

    drive(StationApp(FakeLab(tmp_path, late)), use)


def test_a_run_with_more_events_than_can_be_shown_loses_no_step(tmp_path):
    def hasty(run: FakeRun) -> RunEnded:
        for name in STEPS:
            run.step(name, *(ProgressEvent(f"frame {i}", i, 300) for i in range(300)), seen(True))
        return RunEnded("finished")

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until("new session")
        assert all(f"✓ {name.capitalize()}" in driver.text for name in STEPS)

    drive(StationApp(FakeLab(tmp_path, hasty)), use)


@pytest.mark.slow
@BOTH
def test_a_curve_that_explains_is_shown_with_its_sentence_and_leaves_room_for_the_question(tmp_path, size):
    def explained(run: FakeRun) -> RunEnded:
        optics = ImagingGeometry(50.0, 8.0, 0.9375)
        run.answers = [*run.step("distance", DiagramEvent(gamma_diagram(optics, 4, 17, 1.3)), MOVED)]
        return RunEnded("stopped")

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(MOVED.question)
        await driver.until("At s/t 1.3 (18.08 m) the noise amplification")
        await driver.until("(12.39")

    drive(StationApp(FakeLab(tmp_path, explained)), use, size)


@pytest.mark.slow
def test_a_session_that_began_with_a_shaker_goes_on_with_one_and_others_do_not(tmp_path):
    began = StationLab(sessions=tmp_path / "sessions", config=None, simulate=True, shaker=True)
    began.begin("restoration", "D90", "50 mm", ScriptedOperator({"scene": stopping})).go()
    began.close()
    lab = StationLab(sessions=began.sessions, config=None, simulate=True)

    async def use(driver: Driver) -> None:
        await driver.until("Or continue a session")
        await driver.press("tab", "enter")
        await driver.until("The shaker makes")
        await driver.press("ctrl+c")
        await driver.until("continue where it stopped")

    drive(StationApp(lab), use)
    lines = read_session(lab.kept()[0].folder).contents.lines
    assert ["shaker" in line.data["devices"] for line in lines if line.event == "devices"] == [True, True]
    lab.begin("restoration", "D90", "50 mm", ScriptedOperator({"blur_by": stopping})).go()
    assert "shaker" not in lab.open().bench.devices
    lab.close()


def stopping(ask: Ask) -> bool:
    raise Stopped
