"""Controllers of Physik Instrumente with GCS 2.0: `MOV 1 10.5`, `POS? 1`, and single bytes that act at once.

An order is not acknowledged, so each is followed by `ERR?`, which reports the last error and forgets it. The reply to a
query repeats the axis before its value. An axis that was switched off reports that it is not referenced.
Source: PI, GCS 2.0 commands, in the user manuals of the C-863 and C-884.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

from drivers.errors import NoAnswer, Rejected
from drivers.interfaces import Transport, Travel
from drivers.making import LineOptions
from drivers.move_checks import HOME
from drivers.options import axes, text
from drivers.polled_stage import AxisState, PolledAxis, PolledStage
from drivers.protocols.framing import Decoder, LineSplitter, text_of
from drivers.wire.connection import URGENT_S, StepQuestion, anything

TRIES = 3
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


GcsParser = partial(Decoder[str], partial(LineSplitter, 256), text_of)


class GcsStage(PolledStage[str]):
    """Axes of one controller; an axis' number is its identifier. `reference` is the order that searches for it."""

    stop_bytes = b"\n" + STOP_ALL * 3

    def __init__(
        self, transport: Transport[str], axes: Sequence[PolledAxis], *, reference: str = "FRF", **more: Any
    ) -> None:
        super().__init__(transport, axes, **more)
        self._reference = reference
        self._question = StepQuestion[str](b"\n*IDN?\n", lambda line: line if line.count(",") >= 3 else None)

    def _ask(self, data: bytes, pattern: str, allowed: Callable[[], None] = anything, tries: int = TRIES) -> str:
        """The group of the pattern in the reply."""

        def answer(line: str) -> str | None:
            match = re.fullmatch(pattern, line)
            return None if match is None else str(match[1])

        return self._line.request(data, answer, self._question, allowed, tries)

    def _get(self, axis: PolledAxis, query: str, value: str = NUMBER, tries: int = TRIES) -> str:
        pattern = f"{re.escape(str(axis.number))}={value}"
        return self._ask(f"{query}? {axis.number}\n".encode(), pattern, tries=tries)

    def _order(self, axis: PolledAxis, command: str, value: str = "", allowed: Callable[[], None] = anything) -> None:
        """An order, then its error. Raises Rejected."""
        self._ask(b"ERR?\n", r"(\d+)")  # what a damaged line, or a stop, has left
        order = f"{command} {axis.number} {value}".rstrip()
        code = self._ask(f"{order}\nERR?\n".encode(), r"(\d+)", allowed, tries=1)
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
        referenced = bool(moving) or self._referenced(axis)
        return AxisState(axis.to_unit(float(self._get(axis, "POS"))), bool(moving), referenced)

    def _referenced(self, axis: PolledAxis) -> bool:
        """Whether it is; at rest only, as a query that lost its question mark is the order to search: it is stopped."""
        for _ in range(TRIES):
            try:
                return self._get(axis, self._reference, "([01])", tries=1) == "1"
            except NoAnswer as error:
                self._transport.write(self.stop_bytes, within_s=URGENT_S)
                failure = error
        raise failure

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

    makes = GcsStage
    parser = GcsParser
    axes: Annotated[tuple[GcsAxis, ...], axes("number")]
    reference: Literal["FRF", "FNL", "FPL"] = "FRF"
