"""What threads tell the application: each is posted from a thread and handled in the loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from textual.message import Message

from station.app.background import Finished

if TYPE_CHECKING:
    from station.bench.stage_watch import DeviceState


class News(Message):
    """Something lies on the desk."""


class Terminated(Message):
    """The system ends the program, or its terminal is gone."""


class Ended(Message):
    """A job came to its end."""

    def __init__(self, finished: Finished) -> None:
        super().__init__()
        self.finished = finished


class Devices(Message):
    """A device is not as it was."""

    def __init__(self, states: Sequence[DeviceState]) -> None:
        super().__init__()
        self.states = states
