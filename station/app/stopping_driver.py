"""A terminal's driver that stops the bench in the thread that reads the keys, whatever the screens are at."""

from __future__ import annotations

from collections.abc import Callable

from textual.driver import Driver
from textual.events import Key
from textual.message import Message

from station.app.commands import StopEverything


def stopping_first(driver: type[Driver], stop: Callable[[], None]) -> type[Driver]:
    """The driver, which calls `stop` before it hands on the key that asks for it."""

    class StopsFirst(driver):  # type: ignore[misc,valid-type]
        def process_message(self, message: Message) -> None:
            if isinstance(message, Key) and message.key in StopEverything.keys.split(","):
                stop()
            super().process_message(message)

    return StopsFirst
