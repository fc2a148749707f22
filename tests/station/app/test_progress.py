"""Progress display of the guide during work and with a question."""

import threading
from dataclasses import replace

from procedures.plan import Advice, Ask
from station.app.app import StationApp
from station.app.screens.guide import AT_WORK
from station.app.widgets import ProgressLine, progress_in_words
from station.drawing.glyphs import UNICODE
from station.guide.frontend import FrameEvent, ProgressEvent, RunEnded

from .driving import BEGIN, Absent, Driver, play
from .fakes import FakeLab, FakeRun, chosen_step, doing, plane

WIDTH = Ask("width", "How wide is the chart?", "number", unit="mm", low=1e-5, high=2.0**53, default=300.0)
MOUNT = Ask("mount", "Mount the chart.")


def test_finished_work_is_not_shown_with_a_question_but_a_note_is(tmp_path):
    note = replace(doing("the chart to print: chart.pdf"), lasts=True)
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, ProgressEvent("going to the middle"), MOUNT, note, WIDTH))
    asked = BEGIN, MOUNT.question, Absent("going to the middle"), ["enter"], "(0.00001 to"
    play(StationApp(lab), *asked, "9007199254740992 mm)", "the chart to print: chart.pdf")


def test_a_trial_that_says_nothing_leaves_the_box_saying_that_there_is_nothing_to_do(tmp_path):
    go = threading.Event()

    def script(run: FakeRun) -> RunEnded:
        run.step("print", FrameEvent(plane(), Advice(True, "")))
        go.wait(20)
        return chosen_step(run, MOUNT)

    lab = FakeLab(tmp_path, script)
    play(StationApp(lab), BEGIN, "plane G1, 90 x 60 pixels", AT_WORK, go, MOUNT.question)


def test_a_run_that_ends_while_its_screen_is_taken_down_is_no_fault(tmp_path):
    go = threading.Event()

    def script(run: FakeRun) -> RunEnded:
        run.step("print", doing("exposing"))
        go.wait(20)
        return RunEnded("emergency")

    async def take_down(driver: Driver) -> None:
        await driver.app.screen.query(ProgressLine).remove()

    app = StationApp(FakeLab(tmp_path, script))
    ended = go, lambda driver: app.running("run") is None, lambda driver: driver.pilot.pause()
    play(app, BEGIN, "exposing", take_down, *ended)


def test_time_that_passed_is_not_shown_as_a_remaining_time():
    assert (
        progress_in_words(ProgressEvent("homing: keep clear"), 5.0, None, UNICODE) == "homing: keep clear  (5 s so far)"
    )
