"""Effects of keys: no accidental move, no second run, no dialog twice, no lost key."""

import asyncio
import threading
from collections.abc import Sequence
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

from .driving import BEGIN, START, Absent, Act, Driver, play
from .fakes import FakeLab, chosen_step
from .test_guide import WIDTH, whole


def pause(seconds: float) -> Act:
    return lambda driver: driver.pilot.pause(seconds)


def post(*keys: str, early_s: float = 0.0) -> Act:
    """Lay keys behind what the application has still to hear, pressed so long before."""

    def lay(driver: Driver) -> bool:
        for key in keys:
            event = Key({".": "full_stop", "\r": "enter"}.get(key, key), key)
            event.time -= early_s
            driver.app.post_message(event)
        return True

    return lay


def still_asked(driver: Driver) -> bool:
    return driver.app._guide.answers.open


def held_down(fractions: Sequence[float]) -> tuple[Act, ...]:
    """Lay an Enter that is repeated at these fractions of the time in which a question is read."""
    begun_s: list[float] = []

    def lay(driver: Driver, fraction: float) -> bool:
        begun_s[:] = begun_s or [driver.app._guide.answers._shown_s]
        event = Key("enter", "\r")
        event.time = begun_s[0] + fraction * MIN_READ_S
        driver.app.post_message(event)
        return True

    return tuple(act for one in fractions for act in (partial(lay, fraction=one), pause(0.5 * MIN_READ_S)))


def test_a_move_is_begun_by_enter_alone_once_it_can_have_been_read(tmp_path):
    ask = Ask(MOVE, "Moving z from 0.0 mm to 700.0 mm.")
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, ask))
    asked = BEGIN, ask.question, "clear: press Enter to move; F12 stops", ["space", "1", "y", "escape"], still_asked
    early = post("\r", early_s=10), pause(0.0), still_asked  # pressed before the question was there, and heard after
    read = pause(1.25 * MIN_READ_S)
    play(StationApp(lab), *asked, read, *held_down((0.5, 1.2)), still_asked, *early, read, ["enter"], "new session")
    assert lab.runs[0].answers == [True]


@pytest.mark.slow
def test_keys_that_are_heard_after_enter_has_closed_the_palette_close_nothing_else(tmp_path):
    pressed = ["ctrl+p", *"help"], "This help", post(*"\r\r\r\r"), "the arrows scroll it", ["escape"]
    play(StationApp(FakeLab(tmp_path, whole)), START, *pressed, START)


def test_the_program_is_left_while_the_palette_comes_up(tmp_path):
    async def leave(driver: Driver) -> None:
        driver.app.push_screen(Palette())
        driver.app.exit(0)
        await asyncio.sleep(0.1)

    play(StationApp(FakeLab(tmp_path, whole)), START, leave)


def test_a_screen_that_misses_its_parts_while_the_program_is_left_is_no_fault(tmp_path):
    async def leave(driver: Driver) -> None:
        driver.app.exit(0)
        driver.app.front.call_later(driver.app.front.query_one, "#taken-down")
        await asyncio.sleep(0.01)

    app = StationApp(FakeLab(tmp_path, whole))
    play(app, START, leave)
    assert app.return_code == 0


@pytest.mark.slow
def test_enter_twice_begins_one_run(tmp_path):
    def begin(driver: Driver) -> bool:
        screen = driver.app.front
        return all(screen.post_message(screen.Begin("pattern", "c", "l")) for _ in range(3))

    lab = FakeLab(tmp_path, whole)
    play(StationApp(lab), START, begin, WIDTH.question)
    assert len(lab.runs) == 1


@pytest.mark.parametrize("keys", [["ctrl+q", "ctrl+q", "ctrl+q", "1"], ["ctrl+q", "x", "y", "enter", "enter"]], ids=str)
def test_the_question_before_leaving_stays_one_whatever_is_typed(tmp_path, keys):
    def back(driver: Driver) -> bool:
        return driver.app.screen is driver.app.front

    app = StationApp(FakeLab(tmp_path, whole))
    play(app, BEGIN, WIDTH.question, keys, back, lambda driver: app.running("run"))


def test_what_is_typed_replaces_what_is_proposed(tmp_path):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, WIDTH))
    play(StationApp(lab), BEGIN, WIDTH.question, [*"210", "enter"], "new session")
    assert lab.runs[0].answers == [210.0]


FINE = Ask("fine", "How fine?", "number", unit="mm", low=0.0, high=9.0, default=7.0)


def test_a_number_begun_before_its_question_is_there_is_not_cut_short(tmp_path):
    may_ask = threading.Event()

    def slow(run):
        run.step("print", WIDTH)
        may_ask.wait(20)
        run.answers = run.step("distance", FINE)
        return RunEnded("finished")

    lab = FakeLab(tmp_path, slow)
    begun = "One moment.", [*"0.", "enter"], may_ask  # Enter answers nothing that is not asked yet
    with patch.object(parts, "TYPE_AHEAD_S", 20.0):
        play(StationApp(lab), BEGIN, WIDTH, *begun, FINE.question, [*"01", "enter"], "new session")
    assert lab.runs[0].answers == [0.01]


def test_what_is_asked_has_the_focus_at_once_and_keeps_it(tmp_path):
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, WIDTH))

    def ask_anew(driver: Driver) -> bool:
        def ask() -> None:
            driver.app._guide.answers.show_sentence("One moment.")
            driver.app.screen._refresh_layout()  # the line hears late that it was hidden
            driver.app._guide.answers.ask(FINE)

        return driver.app.call_later(ask)

    def typed(driver: Driver) -> bool:
        return driver.app._guide.answers.query_one(parts.InputLine).value == "0.01"

    # typed behind the question; Enter was pressed before it could be read
    acts = ask_anew, post(*"0.01\r"), typed, still_asked, ["enter"], "new session"
    play(StationApp(lab), BEGIN, WIDTH.question, *acts)
    assert lab.runs[0].answers == [0.01]


def test_a_key_pressed_while_the_program_loads_is_not_lost(tmp_path):
    lab, may_load = FakeLab(tmp_path, whole), threading.Event()
    plans = lab.plans
    lab.plans = lambda: may_load.wait(20) and plans()  # type: ignore[method-assign]
    play(StationApp(lab), START, ["f3"], lambda driver: driver.app._wanted_mode, may_load, "Manual moves")


def test_a_run_waits_for_the_bench_where_enter_came_before_anything_was_loaded(tmp_path):
    lab, held = FakeLab(tmp_path, whole), []

    class Late(StationApp):
        def call_after_refresh(self, callback, *args, **options):
            if args[:1] == ("load",):
                held.append(partial(callback, *args))
                return True
            return super().call_after_refresh(callback, *args, **options)

    def load(driver: Driver) -> bool:
        assert not lab.begun
        held[0]()
        return True

    play(Late(lab), BEGIN, pause(0.1), load, WIDTH.question, "not homed")


@pytest.mark.slow
def test_what_moves_is_shown_with_target_place_and_time_left_and_position_from_the_wire(tmp_path):
    lab, go_on = FakeLab(tmp_path, whole), threading.Event()

    def move_to(**target: float) -> None:
        lab.stage.place["z_mm"] = 123.4
        go_on.wait(20)

    lab.stage.move_to, lab.stage.homed = move_to, True  # type: ignore[method-assign]

    def move(driver: Driver) -> bool:
        threading.Thread(target=lambda: lab.bench.motions.move("stage", {"z_mm": 400.0}), daemon=True).start()
        return True

    def arrive(driver: Driver) -> bool:
        lab.stage.place["z_mm"] = 130.5
        return True

    moving = "stage", move, "moving z 123.4 to 400.0 mm", Absent("idle"), arrive
    play(StationApp(lab), *moving, ["f12"], go_on, "last position: z 130.5 mm", size=(120, 40))


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
