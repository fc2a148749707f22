"""Live focus, driven by keys."""

import threading
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

from .driving import Driver, drive
from .fakes import FakeLab, chosen_step

ROOMS = {(80, 24): (42, 5), (120, 40): (84, 10), (200, 50): (126, 15)}
"""The number's room on each terminal, in characters: read from across a room."""
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


@pytest.mark.slow
@pytest.mark.parametrize("size", ROOMS, ids=str)
def test_every_photograph_of_a_folder_shows_which_way_to_turn(tmp_path, measured, size, monkeypatch):
    monkeypatch.setattr(screen, "_took", lambda seen: f"Photograph {seen.number}: measured.")
    lab = FakeLab(tmp_path, lambda run: chosen_step(run))
    incoming = tmp_path / "in"
    incoming.mkdir()

    async def use(driver: Driver) -> None:
        await driver.go("Where do the photographs of the chart come from?", "f7")
        await driver.press("enter", *"in", "enter")
        await driver.until("Take a photograph.")
        for name, words in zip(SCORES, ("a little, either way", "go on the same way", "Turn back 1 step"), strict=True):
            cv2.imwrite(str(incoming / name), np.zeros((4, 4), np.uint8))
            await driver.until(words)
        await driver.until("best 0.400, photograph 2")
        await driver.until("s/t 1.28")
        for line in big_lines("0.350<", *ROOMS[size], "█"):
            assert line in driver.text
        await driver.looks_like(f"focus-{size[0]}")
        await driver.press("escape")
        await driver.until("Where do the photographs of the chart come from?")
        assert driver.app.running("focus") is None

    drive(StationApp(lab), use, size)


@pytest.mark.slow
def test_it_is_chosen_on_the_first_screen_and_a_run_may_use_the_bench_meanwhile(tmp_path, measured):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, Ask("width", "How wide?", "number", default=1.0)))

    async def use(driver: Driver) -> None:
        await driver.until("press Enter to begin")
        await driver.until("live focus")
        await driver.pilot.pause(0.3)
        await driver.press("f7")
        await driver.until("Where do the photographs of the chart come from?")
        await driver.press("enter", ".", "enter")
        await driver.until("Take a photograph.")
        await driver.press("f2", "1")
        await driver.until("How wide?")

    drive(StationApp(lab, ASCII), use)


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
        super().__init__(folder, lambda run: chosen_step(run, Ask("width", "How wide?", "number", default=1.0)))
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

    async def use(driver: Driver) -> None:
        await driver.until("press Enter to begin")
        await driver.until(lambda: driver.app.bench)
        await driver.press("f7")
        await driver.until("the simulated camera")
        await driver.press("1")
        await driver.until("clear: press Enter to move")
        await driver.press("1", "space", "right")
        assert not lab.stage.homed
        await driver.pilot.pause(1.25 * MIN_READ_S)
        await driver.press("enter")
        await driver.until("Photograph 1, 2.png")
        await driver.press("right")
        await driver.until("Turn 1 step towards near: frame 1 was sharper")
        await driver.press("left", "left")
        await driver.until("Turn 1 step towards infinity: frame 1 was sharper")
        await driver.until("best 0.400, photograph 1")
        await driver.until("Photograph 4, 1.png")
        await driver.press("f2", "1")
        await driver.until("Live focus uses the bench: end it first")
        assert lab.runs == []
        await driver.press("f12")
        await driver.until(lambda: lab.stage.stops)
        await driver.until(lambda: driver.app.running("focus") is None)
        await driver.press("f7")
        await driver.until("Where do the photographs of the chart come from?")

    drive(StationApp(lab), use, (120, 40))
    assert all(lab.camera.homed_first)
    assert len(lab.camera.homed_first) == 4


@pytest.mark.slow
def test_a_folder_that_is_not_there_is_named_and_asked_again(tmp_path):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run))

    async def use(driver: Driver) -> None:
        await driver.go("Where do the photographs of the chart come from?", "f7")
        await driver.press("enter", *"nowhere", "enter")
        await driver.until("there is no folder nowhere")
        await driver.until("Where do the photographs of the chart come from?")

    drive(StationApp(lab), use)


def test_a_photograph_without_a_measurement_shows_the_reason(tmp_path, measured, monkeypatch):
    refused = Outcome(None, Verdict.REFUSED, "no chart in the photograph", "show all of it")
    monkeypatch.setattr(live, "measure_sharpness", lambda *_: refused)
    lab = FakeLab(tmp_path, lambda run: chosen_step(run))

    async def use(driver: Driver) -> None:
        await driver.go("Where do the photographs of the chart come from?", "f7")
        await driver.press("enter", ".", "enter")
        await driver.until("Take a photograph.")
        cv2.imwrite("1.png", np.zeros((4, 4), np.uint8))
        await driver.until("This photograph cannot be measured: no chart in the photograph. What to do: ")

    drive(StationApp(lab), use)


def test_leaving_ends_it(tmp_path, measured):
    lab, threads = FakeLab(tmp_path, lambda run: chosen_step(run)), threading.active_count()

    async def use(driver: Driver) -> None:
        await driver.go("Where do the photographs of the chart come from?", "f7")
        await driver.press("enter", ".", "enter")
        await driver.until("Take a photograph.")
        await driver.press("ctrl+q")

    app = StationApp(lab)
    drive(app, use)
    app.finish(20.0)
    assert threading.active_count() <= threads + 1  # the watcher of devices may still be at its last look


@pytest.mark.parametrize("room", ROOMS.values(), ids=str)
def test_letters_are_as_large_as_there_is_room_for(room):
    lines = big_lines("0.412>", *room, "#")
    assert len(lines) == room[1]
    assert max(map(len, lines)) == room[0]


def test_a_number_without_room_is_written_as_it_is():
    assert big_lines("0.412<", 20, 5, "#") == ["0.412<"]
