"""Controllers of Physik Instrumente with GCS 2.0: `MOV 1 10.5`, `POS? 1`, and single bytes that act at once.

An order is not acknowledged, so each is followed by `ERR?`, which reports the last error and forgets it. The reply to a
query repeats the axis before its value. An axis that was switched off reports that it is not referenced.
Source: PI, GCS 2.0 commands, in the user manuals of the C-863 and C-884.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from drivers.clock import Clock
from drivers.errors import Rejected
from drivers.homing_state import HOME
from drivers.interfaces import Transport, Travel
from drivers.making import LineOptions, MakerContext
from drivers.options import PollInterval, axes, text
from drivers.polled_stage import AxisState, PolledAxis, PolledStage
from drivers.protocols.framing import LineSplitter
from drivers.wire.connection import anything
from drivers.wire.in_step import Question

MOTION, STOP_ALL = b"\x05", b"\x18"
ERRORS = {
    "2": "it does not know the command",
    "5": "the axis is not referenced, or its servo is off",
    "7": "the target is outside its travel",
    "8": "a parameter is missing",
    "10": "it was stopped",
    "15": "there is no such axis",
    "23": "there is no such axis",
}
NUMBER = r"([-+]?\d+\.?\d*(?:[Ee][-+]?\d+)?)"


class GcsParser:
    """Bytes to lines."""

    def __init__(self) -> None:
        self._lines = LineSplitter(256)

    def feed(self, data: bytes) -> list[str]:
        """The lines completed by these bytes."""
        return [line.decode("ascii", "replace").strip() for line in self._lines.feed(data)]


class GcsStage(PolledStage[str]):
    """Axes of one controller; an axis' number is its identifier. `reference` is the order that searches for it."""

    stop_bytes = b"\n" + STOP_ALL * 3

    def __init__(
        self,
        transport: Transport[str],
        axes: Sequence[PolledAxis],
        *,
        clock: Clock | None = None,
        poll_s: float = 0.1,
        reference: str = "FRF",
    ) -> None:
        super().__init__(transport, axes, clock=clock, poll_s=poll_s)
        self._reference = reference
        self._question = Question[str](b"\n*IDN?\n", lambda line: line if line.count(",") >= 3 else None)

    def _ask(self, data: bytes, pattern: str, allowed: Callable[[], None] | None = None) -> str:
        """The group of the pattern in the reply; an order is given only once."""

        def answer(line: str) -> str | None:
            match = re.fullmatch(pattern, line)
            return None if match is None else str(match[1])

        return self._line.request(data, answer, self._question, allowed or anything, 3 if allowed is None else 1)

    def _get(self, axis: PolledAxis, query: str, value: str = NUMBER) -> str:
        return self._ask(f"{query}? {axis.number}\n".encode(), f"{re.escape(str(axis.number))}={value}")

    def _order(self, axis: PolledAxis, command: str, value: str = "", allowed: Callable[[], None] = anything) -> None:
        """An order, then its error. Raises Rejected."""
        self._ask(b"ERR?\n", r"(\d+)")  # what a damaged line, or a stop, has left
        order = f"{command} {axis.number} {value}".rstrip()
        code = self._ask(f"{order}\nERR?\n".encode(), r"(\d+)", allowed)
        if code != "0":
            reason = ERRORS.get(code, f"error {code}")
            raise Rejected(f"{axis.name} at {self.address} refused {order}: {reason}", HOME, code)

    def _introduce(self) -> tuple[str, str, str]:
        _, model, serial, firmware, *_ = self._ask(b"*IDN?\n", "(.*,.*,.*,.*)").split(",")
        return f"PI {model.strip()}", firmware.strip(), serial.strip()

    def _prepare(self, axis: PolledAxis) -> tuple[Travel, float]:
        self._order(axis, "SVO", "1")
        if axis.speed_per_s is not None:
            self._order(axis, "VEL", f"{axis.speed_per_s / abs(axis.scale):.6g}")
        ends = [float(self._get(axis, end)) for end in ("TMN", "TMX")]
        return axis.travel_between(*ends), float(self._get(axis, "VEL")) * abs(axis.scale)

    def _state(self, axis: PolledAxis) -> AxisState:
        moving = int(self._ask(MOTION, "([0-9A-Fa-f]+)"), 16)  # of any axis
        referenced = self._get(axis, self._reference, "([01])")
        return AxisState(axis.to_unit(float(self._get(axis, "POS"))), bool(moving), referenced == "1")

    def _begin_homing(self, axis: PolledAxis, allowed: Callable[[], None]) -> None:
        self._order(axis, "SVO", "1")
        self._order(axis, self._reference, allowed=allowed)

    def _begin_move(self, axis: PolledAxis, value: float, allowed: Callable[[], None]) -> None:
        self._order(axis, "MOV", f"{axis.to_device(value):.6f}", allowed)


@dataclass(frozen=True, kw_only=True)
class GcsAxis(PolledAxis):
    """An axis of driver "gcs": its number is its identifier at the controller."""

    number: Annotated[str, text('"1"', "the identifier of an axis in quotes")]


@dataclass(frozen=True, kw_only=True)
class GcsOptions(LineOptions):
    """Options of driver "gcs"."""

    axes: Annotated[tuple[GcsAxis, ...], axes("number")]
    poll_s: PollInterval = 0.1
    reference: Literal["FRF", "FNL", "FPL"] = "FRF"

    def make(self, parts: MakerContext) -> GcsStage:
        """The stage."""
        wire = parts.wire(self.port, GcsParser, baud=self.baud)
        return GcsStage(wire, self.axes, clock=parts.clock, poll_s=self.poll_s, reference=self.reference)
