"""A terminal driver that stops the bench from the thread that reads the keys, independent of the screens."""

from collections.abc import Callable
from contextlib import suppress

from textual.driver import Driver
from textual.events import Key
from textual.message import Message

from station.app.commands import EndRun, StopEverything

PASTED_S = 0.005
"""Enter that follows a character within this time is part of a pasted text, and must not answer: fingers are slower."""


def stopping_first(driver: type[Driver], stop: Callable[[], None], moving: Callable[[], bool]) -> type[Driver]:
    """The driver extended to call `stop` before it passes on the stop key, and before it is suspended. The key that
    ends a run is a stop key while an axis is `moving`."""

    class StopsFirst(driver):  # type: ignore[misc,valid-type]
        _typed_s = -1.0

        def process_message(self, message: Message) -> None:
            if isinstance(message, Key):
                pasted = message.key == "enter" and message.time - self._typed_s < PASTED_S
                self._typed_s = message.time if pasted or message.is_printable else -1.0
                if pasted:
                    return
            if isinstance(message, Key) and (
                message.key in StopEverything.keys.split(",") or (message.key in EndRun.keys.split(",") and moving())
            ):
                stop()
                message = StopEverything()
            super().process_message(message)

        # not within the signal handler as Textual does: the main thread may hold a lock that this needs
        def _sigtstp_application(self, *_: object) -> None:
            self._do_soon(self._stop_then_suspend)

        def _sigcont_application(self, *_: object) -> None:
            if self._must_signal_resume:
                super()._sigcont_application()
            else:
                self._do_soon(self._begin_again)

        def _do_soon(self, act: Callable[[], None]) -> None:
            with suppress(RuntimeError):  # the loop is closed; nothing moves
                self._loop.call_soon_threadsafe(act)

        def _stop_then_suspend(self) -> None:
            stop()  # the signal thread may still be stopping it
            self.send_message(StopEverything())
            super()._sigtstp_application()

        def _begin_again(self) -> None:
            """Resume after SIGSTOP, which cannot be handled: the shell has changed the terminal's mode."""
            self.suspend_application_mode()
            self.resume_application_mode()

    return StopsFirst
