"""A terminal's driver that stops the bench in the thread that reads the keys, whatever the screens are at."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from textual.driver import Driver
from textual.events import Key
from textual.message import Message

from station.app.commands import EndRun, StopEverything


def stopping_first(driver: type[Driver], stop: Callable[[], None], moving: Callable[[], bool]) -> type[Driver]:
    """The driver, which calls `stop` before it hands on the key that asks for it, and before it is suspended.

    The key that ends a run asks for the stop while an axis is `moving`.
    """

    class StopsFirst(driver):  # type: ignore[misc,valid-type]
        def process_message(self, message: Message) -> None:
            if isinstance(message, Key) and (
                message.key in StopEverything.keys.split(",") or (message.key in EndRun.keys.split(",") and moving())
            ):
                stop()
                message = StopEverything()
            super().process_message(message)

        # Textual would act within the signal handler: the main thread may hold a lock that this takes
        def _sigtstp_application(self, *_: object) -> None:
            self._do_soon(self._stop_then_suspend)

        def _sigcont_application(self, *_: object) -> None:
            if self._must_signal_resume:
                super()._sigcont_application()
            else:
                self._do_soon(self._begin_again)

        def _do_soon(self, act: Callable[[], None]) -> None:
            with suppress(RuntimeError):  # the loop is closed, and nothing moves any more
                self._loop.call_soon_threadsafe(act)

        def _stop_then_suspend(self) -> None:
            stop()  # the thread that hears signals may still be at it
            self.send_message(StopEverything())
            super()._sigtstp_application()

        def _begin_again(self) -> None:
            """After SIGSTOP, which no program hears: its threads still run, and the shell has set the terminal."""
            self.suspend_application_mode()
            self.resume_application_mode()

    return StopsFirst
