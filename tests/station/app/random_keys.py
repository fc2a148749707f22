"""Keys pressed at random on every screen and dialog, and what must never come of it."""

import asyncio
import gc
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from textual.css.stylesheet import Stylesheet
from textual.screen import Screen

from procedures.plan import Ask
from station.app import working_app
from station.app.app import StationApp
from station.app.screens import parts
from station.guide.frontend import MOVE, RunEnded
from station.guide.workspace import SessionSummary

from .fakes import STEPS, FakeLab, FakeRun, doing, seen

KEYS = (
    *("enter",) * 8, *("ctrl+q",) * 3, *("escape", "up", "down", "left", "right", "space", "tab", "shift+tab") * 2,
    *(f"f{n}" for n in (1, 2, 3, 4, 5, 6, 7, 8, 12)), "ctrl+x", "ctrl+c", "ctrl+p", "question_mark", "backspace",
    *"123abchdwprxyz[]-+ 90", "home", "end", "pageup", "pagedown", "delete", "ctrl+a", "ctrl+u",
)  # fmt: skip
WIDTH = Ask("width", "How wide?", "number", unit="mm", low=1, high=9, default=3.0)
VERDICT = Ask("verdict", "Accept?", "choice", default="accept", choices=("accept", "retake"))
CONFIRMING = ("enter", "space", " ", "1")
JOGGING = ("left", "right", "minus", "plus", "-", "+")

KEYS_A_PAINT = 6
PATIENCE_S = 20.0
RESTS = 0.02
"""The share of keys after which it is waited so long as it takes to read that something will move."""


class Bystander:
    """Watches what the keys lead to: every run, every move, and the keys before it."""

    def __init__(self) -> None:
        self.pressed: list[str] = []
        self.wrong: list[str] = []
        self.running = 0
        self.moves = self.runs = self.jogs = 0
        self._lock = threading.Lock()

    def expect(self, holds: bool, what: str) -> None:
        if not holds:
            self.wrong.append(f"{what} after {self.pressed[-12:]}")

    def run(self, run: FakeRun) -> RunEnded:
        """A run that moves twice and asks everything there is to ask."""
        with self._lock:
            self.running += 1
            self.runs += 1
            self.expect(self.running == 1, "two runs on one bench")
        try:
            for name in STEPS:
                before = self.pressed.count("enter")
                run.step(name, Ask(MOVE, "Homing each axis to its switch: z."))
                self.expect(self.pressed.count("enter") > before, "the run moves")
                self.moves += 1
                run.step(name, doing("exposing"), seen(), WIDTH, VERDICT)
            return RunEnded("finished")
        finally:
            with self._lock:
                self.running -= 1

    def home(self, home: Callable[..., None]) -> Callable[..., None]:
        """Homing by hand: the last H was followed by a key that confirms."""

        def watched(allowed: Callable[[], None] = lambda: None) -> None:
            after = self.pressed[len(self.pressed) - self.pressed[::-1].index("h") :] if "h" in self.pressed else []
            self.expect(any(key in CONFIRMING for key in after), "a stage homes")
            home(allowed)

        return watched

    def move_to(self, **target: float) -> None:
        """Moving by hand: not more often than its keys were pressed."""
        self.jogs += 1
        self.expect(self.jogs <= sum(key in JOGGING for key in self.pressed), "a stage moves")


@contextmanager
def in_haste(pressed: Sequence[str]) -> Iterator[None]:
    """Keys come one after the other, whatever the screen still does; and all is shown and read as fast as they come."""

    async def shortly(*_: float) -> None:
        await asyncio.sleep(0.001)

    quickly = patch.object(parts, "MIN_READ_S", 0.03), patch.object(working_app, "SHOW_EVERY_S", 0.01)
    with (
        quickly[0],
        quickly[1],
        patch("textual.app.wait_for_idle", shortly),
        painting_seldom(pressed),
        beginning_quickly(),
    ):
        yield


@contextmanager
def painting_seldom(pressed: Sequence[str]) -> Iterator[None]:
    """One paint in so many keys, as where they are pasted or the line is slow; layout and styles are made for each."""
    paint, painted = Screen._compositor_refresh, -KEYS_A_PAINT

    def seldom(screen: Screen[Any]) -> None:
        nonlocal painted
        if len(pressed) >= painted + KEYS_A_PAINT:
            painted = len(pressed)
            paint(screen)

    with patch.object(Screen, "_compositor_refresh", seldom):
        yield


@contextmanager
def beginning_quickly() -> Iterator[None]:
    """Applications begun one after the other read the same style sheets once, and what they held is given back.

    An application freezes what it has loaded, for its process has no other; of hundreds that came to gigabytes.
    """
    parsed: dict[Any, Any] = {}
    parse = Stylesheet._parse_rules

    def parse_once(sheet: Stylesheet, css: str, **options: Any) -> Any:
        key = css, *options.items(), frozenset(sheet._variables.items())
        if key not in parsed:
            parsed[key] = parse(sheet, css, **options)
        return parsed[key]

    gc.freeze()
    before = gc.get_threshold()
    gc.set_threshold(50_000, 20, 100)  # many small widgets: by default a fifth of the time is spent looking for garbage
    with patch.object(Stylesheet, "_parse_rules", parse_once), patch.object(gc, "freeze"):
        yield
    gc.set_threshold(*before)
    gc.unfreeze()


def press_at_random(folder: Path, seed: int, keys: int) -> Bystander:
    """So many keys; the application is begun again where they ended it. What was seen."""
    rng, seen = np.random.default_rng(seed), Bystander()
    with in_haste(seen.pressed):
        while len(seen.pressed) < keys:
            asyncio.run(_one_application(folder, rng, seen, keys))
    return seen


async def _one_application(folder: Path, rng: np.random.Generator, seen: Bystander, keys: int) -> None:
    kept = SessionSummary(folder / "old", "pattern", "D90", "50 mm", "2026-03-14T09:26:53", ("print",), None)
    lab = FakeLab(folder, seen.run, [kept])
    lab.stage.home = seen.home(lab.stage.home)  # type: ignore[method-assign]
    lab.stage.move_to = seen.move_to  # type: ignore[method-assign]
    app = StationApp(lab)
    async with app.run_test(size=(80, 24)) as pilot:
        while len(seen.pressed) < keys and app.is_running and app.return_value is None:
            seen.pressed.append(str(rng.choice(KEYS)))
            await app._press_keys(seen.pressed[-1:])  # without waiting until every widget has heard of it
            if rng.random() < RESTS:
                await pilot.pause(1.5 * parts.MIN_READ_S)
        loop = app._task
        app.exit(0)
        if loop is not None:  # as in a terminal, the screens go when no key is heard any more
            await asyncio.wait([loop], timeout=PATIENCE_S)
    for run in lab.runs:
        run.operator.stop()
    app.finish(PATIENCE_S)
