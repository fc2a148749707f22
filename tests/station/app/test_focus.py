"""Live focus, driven by keys."""

import threading
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from procedures.outcome import Outcome, Quantity, Verdict
from procedures.plan import Ask
from procedures.raw import Plane
from station.app.app import StationApp
from station.app.screens import focus as screen
from station.app.screens.parts import MIN_READ_S
from station.drawing.glyphs import ASCII, big_lines
from station.guide.focus import live
from station.guide.workspace import OpenedBench

from .driving import START, Act, Driver, play
from .fakes import FakeLab, chosen_step

ROOMS = {(80, 24): (42, 5), (120, 40): (84, 10), (200, 50): (126, 15)}
"""The number's room on each terminal, in characters: read from across a room."""
WIDTH = Ask("width", "How wide?", "number", default=1.0)
READ_S = 1.25 * MIN_READ_S
SCORES = {"1.png": 0.30, "2.png": 0.40, "3.png": 0.35}


def sharpness(score: float) -> SimpleNamespace:
    """As if a photograph had been measured."""
    numbers = {name: Quantity(score, "cycles/pixel", 0.002, "test", 9) for name in ("mtf50", "along_rows")}
    corners = np.array([[10.0, 10.0], [50.0, 30.0]])
    return SimpleNamespace(
        **numbers, along_columns=Quantity(score - 0.01, "cycles/pixel", 0.002, "test", 9), s_over_t=1.28,
        astigmatism=(0.01, 0.003), sighting=SimpleNamespace(marks={}, corners=corners),
    )  # fmt: skip


@pytest.fixture
def lab(tmp_path) -> FakeLab:
    return FakeLab(tmp_path, chosen_step)


@pytest.fixture
def measured(monkeypatch, tmp_path):
    """Photographs are as sharp as their names say."""

    def measure(plane, chart, parameters, near):
        return Outcome(sharpness(float(plane.samples.flat[0])))

    def read(path, names):
        return {names[0]: Plane(names[0], np.full((60, 90), SCORES[path.name]), 1 / 1023)}

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(live, "measure_sharpness", measure)
    monkeypatch.setattr(live, "read_planes", read)
    monkeypatch.setattr(live, "default_plane", lambda path: "G1")
    monkeypatch.setattr(screen, "marks_of", lambda sighting: ((10.0, 10.0), (50.0, 30.0)))


WHERE = "Where do the photographs of the chart come from?"
FOLDER = START, ["f7"], WHERE, ["enter", ".", "enter"], "Take a photograph."
"""Those of the folder of work are shown."""


def ended(driver: Driver) -> bool:
    return driver.app.running("focus") is None


@pytest.mark.slow
@pytest.mark.parametrize("size", ROOMS, ids=str)
def test_every_photograph_of_a_folder_shows_which_way_to_turn(lab, measured, size, monkeypatch):
    monkeypatch.setattr(screen, "_took", lambda seen: f"Photograph {seen.number}: measured.")
    Path("in").mkdir()

    def taken(name: str) -> Act:
        return lambda driver: cv2.imwrite(f"in/{name}", np.zeros((4, 4), np.uint8))

    words = "a little, either way", "go on the same way", "Turn back 1 step"
    turns = [act for name, turn in zip(SCORES, words, strict=True) for act in (taken(name), turn)]
    number = "best 0.400, photograph 2", "s/t 1.28", *big_lines("0.350<", *ROOMS[size], "█")
    begin = START, ["f7"], WHERE, ["enter", *"in", "enter"], "Take a photograph."
    end = lambda driver: driver.looks_like(f"focus-{size[0]}"), ["escape"], WHERE, ended
    play(StationApp(lab), *begin, *turns, *number, *end, size=size)


@pytest.mark.slow
def test_it_is_chosen_on_the_first_screen_and_a_run_may_use_the_bench_meanwhile(lab, measured):
    lab.script = lambda run: chosen_step(run, WIDTH)
    first = START, "live focus", lambda driver: driver.pilot.pause(0.3)
    play(StationApp(lab, ASCII), *first, *FOLDER[1:], ["f2", "1"], WIDTH.question)


class FakeCamera:
    """Photographs of one sharpness after the other, as the ring is turned."""

    address = "nowhere"

    def __init__(self, folder, stage) -> None:
        self.folder, self.stage, self.turned = folder, stage, 0.0
        self.homed_first: list[bool] = []

    def connect(self):
        return self.stage.connect()

    def condition(self):
        return self.stage.condition()

    def emergency_stop(self) -> None: ...

    def close(self) -> None: ...

    def expose(self):
        self.homed_first.append(self.stage.homed)
        return SimpleNamespace(path=self.folder / f"{min(2 + round(self.turned), 3)}.png")

    # the simulated person
    def take_up(self, facts) -> None: ...

    def follow(self, by_hand) -> None:
        self.turned += by_hand.get("focus_steps", 0.0)


class SimulatedLab(FakeLab):
    """A bench with a camera, a lamp, and an operator model that turns the ring."""

    def __init__(self, folder) -> None:
        super().__init__(folder, lambda run: chosen_step(run, WIDTH))
        self.camera = FakeCamera(folder, self.stage)
        lamp = SimpleNamespace(
            address="", connect=self.camera.connect, condition=self.camera.condition, set_level=lambda level: None,
            emergency_stop=lambda: None, close=lambda: None,
        )  # fmt: skip
        self.bench.devices.update(head=self.stage, camera=self.camera, light=lamp)  # type: ignore[dict-item]
        self.bench.drivers = dict.fromkeys(self.bench.devices, "fake")
        self.bench.surroundings = SimpleNamespace(hands=self.camera, stand_before=lambda subject: None)  # type: ignore[assignment]

    def open(self) -> OpenedBench:
        return OpenedBench(self.bench, ())


@pytest.mark.slow
def test_the_simulated_ring_turns_by_keys_and_stages_move_by_enter_alone(tmp_path, measured):
    lab = SimulatedLab(tmp_path)
    chosen = START, lambda driver: driver.app.bench, ["f7"], "the simulated camera", ["1"], "clear: press Enter to move"
    asked = ["1", "space", "right"], lambda driver: not lab.stage.homed, lambda driver: driver.pilot.pause(READ_S)
    moved = ["enter"], "Photograph 1, 2.png", ["right"], "Turn 1 step towards near: frame 1 was sharper"
    back = ["left", "left"], "Turn 1 step towards infinity: frame 1 was sharper"
    best = "best 0.400, photograph 1", "Photograph 4, 1.png"
    busy = ["f2", "1"], "Live focus uses the bench: end it first", lambda driver: not lab.runs
    stopped = ["f12"], lambda driver: lab.stage.stops, ended, ["f7"], WHERE
    play(StationApp(lab), *chosen, *asked, *moved, *back, *best, *busy, *stopped, size=(120, 40))
    assert all(lab.camera.homed_first)
    assert len(lab.camera.homed_first) == 4


@pytest.mark.slow
def test_a_folder_that_is_not_there_is_named_and_asked_again(lab):
    nowhere = ["enter", *"nowhere", "enter"], "there is no folder nowhere", WHERE
    play(StationApp(lab), START, ["f7"], WHERE, *nowhere)


def test_a_photograph_without_a_measurement_shows_the_reason(lab, measured, monkeypatch):
    refused = Outcome(None, Verdict.REFUSED, "no chart in the photograph", "show all of it")
    monkeypatch.setattr(live, "measure_sharpness", lambda *_: refused)
    reason = "This photograph cannot be measured: no chart in the photograph. What to do: "
    play(StationApp(lab), *FOLDER, lambda driver: cv2.imwrite("1.png", np.zeros((4, 4), np.uint8)), reason)


def test_leaving_ends_it(lab, measured):
    threads, app = threading.active_count(), StationApp(lab)
    play(app, *FOLDER, ["ctrl+q"])
    app.finish(20.0)
    assert threading.active_count() <= threads + 1  # the watcher of devices may still be at its last look


@pytest.mark.parametrize("room", ROOMS.values(), ids=str)
def test_letters_are_as_large_as_there_is_room_for(room):
    lines = big_lines("0.412>", *room, "#")
    assert len(lines) == room[1]
    assert max(map(len, lines)) == room[0]


def test_a_number_without_room_is_written_as_it_is():
    assert big_lines("0.412<", 20, 5, "#") == ["0.412<"]
