"""Effects of keys: no accidental move, no second run, no dialog twice, no lost key."""

import asyncio
import threading
from functools import partial
from unittest.mock import patch

import pytest
from textual.events import Key

from procedures.plan import Ask
from station.app.app import Palette, StationApp
from station.app.screens import parts
from station.app.screens.parts import MIN_READ_S
from station.app.stopping_driver import PASTED_S, stopping_first
from station.guide.frontend import MOVE, RunEnded

from .driving import Driver, drive
from .fakes import FakeLab, chosen_step
from .test_guide import WIDTH, whole


def test_a_move_is_begun_by_enter_alone_once_it_can_have_been_read(tmp_path):
    ask = Ask(MOVE, "Moving z from 0.0 mm to 700.0 mm.")
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, ask))

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(ask.question)
        await driver.until("clear: press Enter to move; F12 stops")
        await driver.press("space", "1", "y", "escape")
        assert driver.app._guide.answers.open
        await driver.pilot.pause(1.25 * MIN_READ_S)
        early = Key("enter", "\r")  # pressed before the question was there, and heard after
        early.time -= 10
        driver.app.post_message(early)
        await driver.pilot.pause()
        assert driver.app._guide.answers.open
        await driver.press("enter")
        await driver.until("new session")

    drive(StationApp(lab), use)
    assert lab.runs[0].answers == [True]


@pytest.mark.slow
def test_keys_that_are_heard_after_enter_has_closed_the_palette_close_nothing_else(tmp_path):
    lab = FakeLab(tmp_path, whole)

    async def use(driver: Driver) -> None:
        await driver.go("This help", "ctrl+p", *"help")
        for key in ["enter"] * 4:
            driver.app.post_message(Key(key, None))
        await driver.until("the arrows scroll it")
        await driver.press("escape")
        await driver.until("press Enter to begin")

    drive(StationApp(lab), use)


def test_the_program_is_left_while_the_palette_comes_up(tmp_path):
    async def use(driver: Driver) -> None:
        await driver.until("press Enter to begin")
        driver.app.push_screen(Palette())
        driver.app.exit(0)
        await asyncio.sleep(0.1)

    drive(StationApp(FakeLab(tmp_path, whole)), use)


def test_a_screen_that_misses_its_parts_while_the_program_is_left_is_no_fault(tmp_path):
    app = StationApp(FakeLab(tmp_path, whole))

    async def use(driver: Driver) -> None:
        await driver.until("press Enter to begin")
        app.exit(0)
        app.front.call_later(app.front.query_one, "#taken-down")
        await asyncio.sleep(0.01)

    drive(app, use)
    assert app.return_code == 0


@pytest.mark.slow
def test_enter_twice_begins_one_run(tmp_path):
    lab = FakeLab(tmp_path, whole)

    async def use(driver: Driver) -> None:
        await driver.until("press Enter to begin")
        screen = driver.app.front
        for _ in range(3):
            screen.post_message(screen.Begin("pattern", "c", "l"))
        await driver.until(WIDTH.question)

    drive(StationApp(lab), use)
    assert len(lab.runs) == 1


@pytest.mark.parametrize("keys", [("ctrl+q", "ctrl+q", "ctrl+q", "1"), ("ctrl+q", "x", "y", "enter", "enter")], ids=str)
def test_the_question_before_leaving_stays_one_whatever_is_typed(tmp_path, keys):
    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(WIDTH.question)
        await driver.press(*keys)
        await driver.until(lambda: driver.app.screen is driver.app.front)
        assert driver.app.running("run")

    drive(StationApp(FakeLab(tmp_path, whole)), use)


def test_what_is_typed_replaces_what_is_proposed(tmp_path):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, WIDTH))

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(WIDTH.question)
        await driver.press(*"210", "enter")
        await driver.until("new session")

    drive(StationApp(lab), use)
    assert lab.runs[0].answers == [210.0]


FINE = Ask("fine", "How fine?", "number", unit="mm", low=0.0, high=9.0, default=7.0)


def typed(app: StationApp, *keys: str) -> None:
    """Lay keys behind what the application has still to hear."""
    for key in keys:
        app.post_message(Key({".": "full_stop", "\r": "enter"}.get(key, key), key))


def test_a_number_begun_before_its_question_is_there_is_not_cut_short(tmp_path):
    may_ask = threading.Event()

    def slow(run):
        run.step("print", WIDTH)
        may_ask.wait(20)
        run.answers = run.step("distance", FINE)
        return RunEnded("finished")

    lab = FakeLab(tmp_path, slow)

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.answer(WIDTH.question)
        await driver.until("One moment.")
        await driver.press(*"0.", "enter")  # Enter answers nothing that is not asked yet
        may_ask.set()
        await driver.until(FINE.question)
        await driver.press(*"01", "enter")
        await driver.until("new session")

    with patch.object(parts, "TYPE_AHEAD_S", 20.0):
        drive(StationApp(lab), use)
    assert lab.runs[0].answers == [0.01]


def test_what_is_asked_has_the_focus_at_once_and_keeps_it(tmp_path):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, WIDTH))

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.until(WIDTH.question)
        box = driver.app._guide.answers

        def ask_anew() -> None:
            box.show_sentence("One moment.")
            driver.app.screen._refresh_layout()  # the line hears late that it was hidden
            box.ask(FINE)

        driver.app.call_later(ask_anew)
        typed(driver.app, *"0.01\r")  # behind the question; Enter was pressed before it could be read
        await driver.until(lambda: box.query_one(parts.InputLine).value == "0.01")
        assert box.open
        await driver.press("enter")
        await driver.until("new session")

    drive(StationApp(lab), use)
    assert lab.runs[0].answers == [0.01]


def test_a_key_pressed_while_the_program_loads_is_not_lost(tmp_path):
    lab, may_load = FakeLab(tmp_path, whole), threading.Event()
    plans = lab.plans

    def slow():
        may_load.wait(20)
        return plans()

    lab.plans = slow  # type: ignore[method-assign]

    async def use(driver: Driver) -> None:
        await driver.go(lambda: driver.app._wanted_mode, "f3")
        may_load.set()
        await driver.until("Manual moves")

    drive(StationApp(lab), use)


def test_a_run_waits_for_the_bench_where_enter_came_before_anything_was_loaded(tmp_path):
    lab, held = FakeLab(tmp_path, whole), []

    class Late(StationApp):
        def call_after_refresh(self, callback, *args, **options):
            if args[:1] == ("load",):
                held.append(partial(callback, *args))
                return True
            return super().call_after_refresh(callback, *args, **options)

    async def use(driver: Driver) -> None:
        await driver.begin()
        await driver.pilot.pause(0.1)
        assert not lab.begun
        held[0]()
        await driver.until(WIDTH.question)
        await driver.until("not homed")

    drive(Late(lab), use)


@pytest.mark.slow
def test_what_moves_is_shown_with_target_place_and_time_left_and_position_from_the_wire(tmp_path):
    lab, reached, go_on = FakeLab(tmp_path, whole), threading.Event(), threading.Event()

    def move_to(**target: float) -> None:
        lab.stage.place["z_mm"] = 123.4
        reached.set()
        go_on.wait(20)

    lab.stage.move_to, lab.stage.homed = move_to, True  # type: ignore[method-assign]

    async def use(driver: Driver) -> None:
        await driver.until("stage")
        mover = threading.Thread(target=lambda: lab.bench.motions.move("stage", {"z_mm": 400.0}), daemon=True)
        mover.start()
        await driver.until("moving z 123.4 to 400.0 mm")
        assert "idle" not in driver.text
        lab.stage.place["z_mm"] = 130.5
        await driver.press("f12")
        go_on.set()
        await driver.until("last position: z 130.5 mm")

    drive(StationApp(lab), use, (120, 40))


def test_enter_in_a_pasted_text_answers_nothing():
    passed = []

    class Base:
        def process_message(self, message):
            passed.append(message.key)

    driver = stopping_first(Base, stop=lambda: passed.append("stop"), moving=lambda: False)()
    times_s = {"at once": PASTED_S / 10, "typed": 10 * PASTED_S}
    now_s = 0.0
    for key, pause in (("1", "typed"), ("enter", "at once"), ("enter", "at once"), ("2", "at once"),
                       ("enter", "typed"), ("enter", "typed"), ("left", "typed"), ("enter", "at once")):  # fmt: skip
        event = Key(key, key if len(key) == 1 else None)
        event.time = now_s = now_s + times_s[pause]
        driver.process_message(event)
    assert passed == ["1", "2", "enter", "enter", "left", "enter"], "only what no finger can type is dropped"
