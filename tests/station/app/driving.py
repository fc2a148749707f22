"""Driving the application with keys, and its screen as plain text."""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import Awaitable, Callable
from inspect import isawaitable
from pathlib import Path

from textual.pilot import Pilot

from procedures.plan import Ask
from station.app.app import StationApp

SCREENS = Path(__file__).parent / "screens"
WRITE = "STATION_WRITE_SCREENS"
"""Where this is set in the environment, the stored screens are written instead of compared."""
PATIENCE_S = 20.0


class Absent(str):
    """A text that is not on the screen."""


Act = str | Absent | Ask | list[str] | threading.Event | Callable[["Driver"], object]
START = "press Enter to begin"
BEGIN = Ask("begin", START)
"""Enter on the first screen."""


class Driver:
    """An application, its keys and its screen."""

    def __init__(self, app: StationApp, pilot: Pilot[int]) -> None:
        self.app, self.pilot = app, pilot

    @property
    def text(self) -> str:
        """The screen as lines of plain text."""
        strips = self.app.screen._compositor.render_strips()
        return "\n".join("".join(segment.text for segment in strip).rstrip() for strip in strips)

    @property
    def words(self) -> str:
        """The screen's text without line breaks."""
        return " ".join(self.text.split())

    @property
    def behind(self) -> str:
        """State of the application for failure messages."""
        threads = ", ".join(thread.name for thread in threading.enumerate())
        app = vars(self.app)
        return f"jobs {app['_jobs']}, devices {app['_bench_words']!r} {app['_states']}, threads {threads}"

    async def press(self, *keys: str) -> None:
        await self.pilot.press(*keys)

    async def until(self, what: str | Callable[[], object]) -> None:
        """Wait until a text is on the screen, or something holds."""
        end = time.monotonic() + PATIENCE_S
        while not (what in self.text or what in self.words if isinstance(what, str) else what()):
            assert time.monotonic() < end, f"waited in vain for {what}; {self.behind}; the screen is\n{self.text}"
            await self.pilot.pause(0.01)

    async def act(self, act: Act) -> None:
        """Carry out one act of `play`."""
        if isinstance(act, Absent):
            assert act not in self.text, self.text
        elif isinstance(act, str):
            await self.until(act)
        elif isinstance(act, Ask):
            await self.until(act.question)
            await self.press("enter")
        elif isinstance(act, list):
            await self.press(*act)
        elif isinstance(act, threading.Event):
            act.set()
        elif isawaitable(done := act(self)):
            await done
        elif not done:
            await self.until(lambda: act(self))

    async def looks_like(self, name: str) -> None:
        """Compare with the stored screen, until both agree."""
        stored = SCREENS / f"{name}.txt"
        if os.environ.get(WRITE):
            await self.pilot.pause(0.1)
            stored.write_text(self.text + "\n", encoding="utf-8")
        wanted, end = stored.read_text(encoding="utf-8"), time.monotonic() + PATIENCE_S
        while self.text + "\n" != wanted and time.monotonic() < end:
            await self.pilot.pause(0.02)
        assert self.text + "\n" == wanted, f"{self.behind}\nwanted\n{wanted}\nthe screen is\n{self.text}"


def drive(app: StationApp, use: Callable[[Driver], Awaitable[None]], size: tuple[int, int] = (80, 24)) -> None:
    """Run the application in a terminal of that size and use it."""

    async def run() -> None:
        async with app.run_test(size=size, notifications=True) as pilot:
            await use(Driver(app, pilot))

    asyncio.run(run())


def play(app: StationApp, *acts: Act, size: tuple[int, int] = (80, 24)) -> None:
    """Carry out acts in an application of that size.

    A text is waited for, a question awaited and answered as proposed, keys in a list are pressed, an event is set; a
    function of the driver is awaited, or waited for until it holds.
    """

    async def use(driver: Driver) -> None:
        for act in acts:
            await driver.act(act)

    drive(app, use, size)
