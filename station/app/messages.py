"""What threads tell the application: each is posted from a thread and handled in the loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from textual.message import Message

from station.app.background import Finished

if TYPE_CHECKING:
    from station.bench.stage_watch import DeviceState


class MailboxFilled(Message):
    """Something lies on the desk."""


class ProgramTerminated(Message):
    """The system ends the program, or its terminal is gone."""


class JobEnded(Message):
    """A job came to its end."""

    def __init__(self, finished: Finished) -> None:
        super().__init__()
        self.finished = finished


class DevicesChanged(Message):
    """A device is not as it was."""

    def __init__(self, states: Sequence[DeviceState]) -> None:
        super().__init__()
        self.states = states
