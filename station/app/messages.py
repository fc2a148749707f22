"""Messages of threads to the application, handled in its loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from textual.message import Message

from station.app.background import Finished

if TYPE_CHECKING:
    from station.bench.stage_watch import DeviceState


class MailboxFilled(Message):
    """The mailbox has entries."""


class ProgramTerminated(Message):
    """The system ends the program, or the terminal has closed."""


class JobEnded(Message):
    """A job has ended."""

    def __init__(self, finished: Finished) -> None:
        super().__init__()
        self.finished = finished


class DevicesChanged(Message):
    """The condition of a device has changed."""

    def __init__(self, states: Sequence[DeviceState]) -> None:
        super().__init__()
        self.states = states
