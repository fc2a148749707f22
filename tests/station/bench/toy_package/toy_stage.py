"""A stage with an invented protocol: a driver of a package outside, with its parser and options, in one file.

`ID COMMAND*CRC` is answered by `ID ok VALUES*CRC` or `ID no REASON*CRC`; CRC is that of CCITT, of 16 bits, as four
hexadecimal digits. `!` stops the motor at once, also within a line.
"""

import itertools
from binascii import crc_hqx
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from toy_twin import ToyTwin

from drivers.errors import Clock, Rejected
from drivers.interfaces import Transport, Travel
from drivers.making import LineOptions, MakerContext
from drivers.move_checks import HOME
from drivers.options import positive
from drivers.polled_stage import REPLY_S, AxisState, PolledAxis, PolledStage
from drivers.protocols.framing import LineSplitter
from drivers.wire.connection import anything

TRIES = 5


class Reply(NamedTuple):
    number: int
    accepted: bool
    words: list[str]


def framed(body: str) -> bytes:
    """A line with its checksum."""
    return f"{body}*{crc_hqx(body.encode(), 0):04X}\n".encode()


class ToyParser:
    """Bytes to replies; damaged lines are dropped."""

    def __init__(self) -> None:
        self._lines = LineSplitter()

    def feed(self, data: bytes) -> list[Reply]:
        bodies = [(line, line[:-5].decode("ascii", "replace")) for line in self._lines.feed(data)]
        parts = [body.split() for line, body in bodies if framed(body) == line + b"\n"]
        return [Reply(int(number), verdict == "ok", words) for number, verdict, *words in parts]


class ToyStage(PolledStage[Reply]):
    """One axis that homes to its low end."""

    stop_bytes = b"!!!!\n"
    """Repeated, so that a lost byte does not leave the motor running."""

    def __init__(self, transport: Transport[Reply], clock: Clock, tolerance_mm: float = 0.002) -> None:
        super().__init__(transport, [PolledAxis("x_mm", tolerance=tolerance_mm)], clock=clock)
        self._numbers = itertools.cycle(range(1, 1000))

    def _order(self, command: str, tries: int = 1, allowed: Callable[[], None] = anything) -> Sequence[str]:
        number = next(self._numbers)
        reply: Reply = self._transport.request(
            framed(f"{number} {command}"), lambda one: one if one.number == number else None, REPLY_S, tries, allowed
        )
        if not reply.accepted:
            raise Rejected(f"{self.address} refused {command!r}: {' '.join(reply.words)}", HOME)
        return reply.words

    def _introduce(self) -> tuple[str, str, str]:
        model, firmware, serial = self._order("who", TRIES)
        return model, firmware, serial

    def _prepare(self, axis: PolledAxis) -> tuple[Travel, float]:
        low, high, speed = map(float, self._order("travel", TRIES))
        return Travel(low, high), speed

    def _state(self, axis: PolledAxis) -> AxisState:
        state, position = self._order("where", TRIES)
        return AxisState(float(position), state in ("moving", "homing"), state != "unhomed")

    def _begin_homing(self, axis: PolledAxis, allowed: Callable[[], None]) -> None:
        self._order("home", allowed=allowed)

    def _begin_move(self, axis: PolledAxis, value: float, allowed: Callable[[], None]) -> None:
        self._order(f"go {value:.4f}", allowed=allowed)


@dataclass(frozen=True, kw_only=True)
class ToyOptions(LineOptions):
    """The keys of its table in station.toml."""

    twin = ToyTwin
    tolerance_mm: Annotated[float, positive("0.002")] = 0.002

    def make(self, parts: MakerContext) -> ToyStage:
        return ToyStage(parts.wire(self.port, ToyParser, baud=self.baud), parts.clock, self.tolerance_mm)
