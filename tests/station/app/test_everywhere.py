"""What holds on every screen: the emergency stop, help, commands by name, strings that mean harm."""

import threading
import time

import pytest

from procedures.plan import Ask
from station.app.app import StationApp
from station.app.commands import BENCH, BY_NAME, EVERYWHERE, GUIDE, RESULTS
from station.guide.frontend import ProgressEvent, RunEnded
from station.guide.workspace import SessionSummary

from .driving import BEGIN, START, Absent, Driver, play
from .fakes import FakeLab, FakeRun, chosen_step

ASK = Ask("width", "How wide?", "number", default=1.0)
HOSTILE = "[bold red]x[/] \x1b[31mred\x1b[0m \u202egpj.exe \x07 [@click=app.quit]q[/]"


def ended(driver: Driver) -> bool:
    return driver.app.running("run") is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("screen", "stop"),
    [("guide", "ctrl+x"), ("f1", "f12"), ("f3", "f12"), ("f4", "f12"), ("ctrl+p", "ctrl+x"), ("ctrl+q", "f12")],
)
def test_the_emergency_stop_works_on_every_screen(tmp_path, screen, stop):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, ASK))
    keys = [stop] if screen == "guide" else [screen, stop]
    play(StationApp(lab), BEGIN, ASK.question, keys, lambda driver: lab.stage.stops, ended)


def test_the_stop_waits_for_no_one(tmp_path):
    lab, held = FakeLab(tmp_path, lambda run: chosen_step(run, ASK)), threading.Event()
    lab.stage.move_to = lambda **target: held.wait(20)  # type: ignore[method-assign]
    pressed = ["f3", "right", "right", "f12"], lambda driver: lab.stage.stops
    play(StationApp(lab), START, *pressed, "EMERGENCY STOP", held)


@pytest.mark.slow
@pytest.mark.parametrize("screen", ["f2", "f3"])
def test_help_and_palette_list_every_command_of_the_screen(tmp_path, screen):
    async def to_the_last(driver: Driver) -> None:
        while "Leave the program" not in driver.words:
            await driver.press("pagedown")

    shown = ["f1"], "Escape closes this", to_the_last, ["end"], "reliability of the measurement", ["escape", "ctrl+p"]
    found = "Search for commands", [*"show help", "enter", "enter"], "The guide (F2) leads"
    app = StationApp(FakeLab(tmp_path, lambda run: RunEnded("finished")))
    play(app, START, [] if screen == "f2" else [screen], lambda driver: app.offered(), *shown, *found)


def test_every_command_says_what_it_does_and_no_key_is_taken_twice():
    for place in (GUIDE, BENCH, RESULTS):
        commands = (*place, *EVERYWHERE)
        keys = [key for command in commands for key in command.keys.split(",")]
        assert len(keys) == len(set(keys))
    assert all(command.help().endswith((".", "away.")) and command.title() for command in BY_NAME.values())


def test_hostile_strings_show_as_text(tmp_path):
    kept = SessionSummary(tmp_path / HOSTILE.replace("/", ""), "pattern", HOSTILE, HOSTILE, HOSTILE, (), HOSTILE)

    def script(run: FakeRun) -> RunEnded:
        return chosen_step(run, ProgressEvent(HOSTILE), Ask("k", HOSTILE, "choice", choices=(HOSTILE, "b")))

    lab = FakeLab(tmp_path, script, [kept])
    lab.names = (HOSTILE, HOSTILE)
    shown = "[bold red]x[/] \\x1b[31mred", ["enter"], "\\u202egpj.exe \\x07", "[@click=app.quit]q[/]"
    play(StationApp(lab), *shown, *map(Absent, "\x1b\x07\u202e"), size=(160, 40))


def test_leaving_asks_first_when_a_run_goes(tmp_path):
    app = StationApp(FakeLab(tmp_path, lambda run: chosen_step(run, ASK)))
    stays = ["ctrl+q"], "A run or a movement is in progress", ["enter"], lambda driver: app.running("run")
    leaves = ["ctrl+q"], "quit after this exposure", ["2"], lambda driver: app.return_value == 0
    play(app, BEGIN, ASK.question, *stays, *leaves)


@pytest.mark.slow
def test_the_first_paint_needs_neither_numpy_nor_bench(tmp_path):
    """Start to first screen: what is slow to load is loaded after it."""
    import subprocess
    import sys

    code = "import sys, station.app.app, station.cli.app; "
    code += "print([m for m in ('numpy', 'numba', 'cv2') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


@pytest.mark.slow
def test_the_loop_goes_on_while_a_run_computes(tmp_path):
    """Keys are answered while a run holds a processor: the run's thread is not the loop's."""
    end = threading.Event()

    def busy(run: FakeRun) -> RunEnded:
        run.operator.notify(ProgressEvent("computing"))
        stop = time.monotonic() + 20
        while not end.is_set() and time.monotonic() < stop:
            sum(range(1000))
        return RunEnded("finished")

    play(StationApp(FakeLab(tmp_path, busy)), BEGIN, "computing", ["f3"], "Manual moves", end)
