"""Newport ESP301 and SMC100: one family of two-letter commands, `1PA10` and `1TP`, in two dialects.

An ESP301 answers a query with its value alone; an SMC100, up to 31 on one line, repeats number and command before it.
Neither acknowledges an order, so each is followed by the query of the last error. Both forget their reference without
power: an ESP301 then reports its motors off, an SMC100 that it is not referenced.
Source: Newport, ESP301 user's manual EDH0235; SMC100CC/PP user's manual EDH0206.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, NamedTuple

from drivers.errors import Alarm, BadConfiguration, Rejected
from drivers.interfaces import Travel
from drivers.making import LineOptions
from drivers.move_checks import HOME
from drivers.options import Baud, PollInterval, axes, option
from drivers.polled_stage import AxisState, PolledAxis, PolledStage
from drivers.protocols.framing import Decoder, LineSplitter, text_of
from drivers.wire.connection import StepQuestion, anything, roll_call

NUMBER = r"([-+]?\d+\.?\d*(?:[Ee][-+]?\d+)?)"
POWER = 1 << 4  # bit of an ESP301's status: the motor of an axis is on. All are off after a power cycle
ERRORS_KEPT = 11
UNITS = {"mm": "2", "deg": "7"}  # codes of the units of an ESP301


class NewportReply(NamedTuple):
    """One line: number and command that an SMC100 repeats, and the value."""

    echo: str
    value: str


def _reply(line: bytes) -> NewportReply | None:
    match = re.fullmatch(r"(\d{1,2}[A-Z]{2})?(.*)", text_of(line))
    return None if match is None else NewportReply(match[1] or "", match[2].strip())


NewportParser = partial(Decoder[NewportReply], partial(LineSplitter, 128), _reply)


class Esp301Stage(PolledStage[NewportReply]):
    """Up to three axes of an ESP301. `search` is its mode of home search: 4 is the negative limit, 1 home and index."""

    stop_bytes = b"\rST\r"
    end = "\r"
    search = 4

    def _question(self, axis: PolledAxis) -> StepQuestion[NewportReply]:
        return StepQuestion(b"\rVE?\r", lambda reply: "ESP" in reply.value or None)

    def _echo(self, axis: PolledAxis, command: str) -> str:
        return ""

    def _ask(self, axis: PolledAxis, text: str, pattern: str, allowed: Callable[[], None] | None = None) -> list[str]:
        """The groups of the pattern in the reply to the last command of a text; an order is given once only."""
        echo = self._echo(axis, text.split(self.end)[-1])

        def answer(reply: NewportReply) -> list[str] | None:
            match = re.fullmatch(pattern, reply.value) if reply.echo == echo else None
            return None if match is None else list(match.groups())

        data, tries = (text + self.end).encode(), 3 if allowed is None else 1
        return self._line.request(data, answer, self._question(axis), allowed or anything, tries)

    def _get(self, axis: PolledAxis, command: str, pattern: str = NUMBER) -> str:
        return self._ask(axis, f"{axis.number}{command}", pattern)[0]

    def _order(self, axis: PolledAxis, command: str, allowed: Callable[[], None] = anything) -> None:
        """An order, then its error. Raises Rejected."""
        # all errors that damaged lines have left, as the next one would be taken for that of this order
        for _ in range(ERRORS_KEPT):
            if self._get(axis, "TE?", r"(\d+)") == "0":
                break
        code, text = self._ask(axis, f"{axis.number}{command};TB?", r"(\d+), *\d+, *(.*)", allowed)
        if code != "0":
            raise Rejected(f"{axis.name} at {self.address} refused {command}: {text.lower()}", HOME, code)

    def _introduce(self) -> tuple[str, str, str]:
        axis = self._axes[0]
        (version,) = self._ask(axis, "VE?", r"ESP\S* *(?:[Vv]ersion)? *(.*)")
        stages = [self._get(axis, "ID?", r"(\w.*\w)") for axis in self._axes]
        return "Newport ESP301", version, "; ".join(stages)

    def _prepare(self, axis: PolledAxis) -> tuple[Travel, float]:
        unit = axis.name.rpartition("_")[2]
        if (code := self._get(axis, "SN?", r"(\d+)")) != UNITS[unit] and abs(axis.scale) == 1.0:
            remedy = f"set it to {UNITS[unit]} with {axis.number}SN{UNITS[unit]}, or give the axis its scale"
            raise BadConfiguration(f"{axis.name} at {self.address} counts in unit {code} of the controller", remedy)
        return self._range_and_speed(axis)

    def _range_and_speed(self, axis: PolledAxis) -> tuple[Travel, float]:
        if axis.speed_per_s is not None:
            self._order(axis, f"VA{axis.speed_per_s / abs(axis.scale):.6g}")
        ends = [float(self._get(axis, f"{end}?")) for end in ("SL", "SR")]
        return axis.travel_between(*ends), float(self._get(axis, "VA?")) * abs(axis.scale)

    def _state(self, axis: PolledAxis) -> AxisState:
        """From the controller's status, a character: a query that lost its question mark may be an order."""
        bits = ord(self._ask(axis, "TS", "([@-_])[@-_]?")[0])
        moving = bits >> int(axis.number) - 1 & 1
        return AxisState(axis.to_unit(float(self._get(axis, "TP"))), bool(moving), bool(bits & POWER))

    def _begin_homing(self, axis: PolledAxis, allowed: Callable[[], None]) -> None:
        self._order(axis, f"MO;{axis.number}OR{self.search}", allowed)

    def _begin_move(self, axis: PolledAxis, value: float, allowed: Callable[[], None]) -> None:
        self._order(axis, f"PA{axis.to_device(value):.5f}", allowed)


class Smc100Stage(Esp301Stage):
    """SMC100 controllers on one line, each with one axis; a stage's number is the address of its controller."""

    stop_bytes = b"\r\nST\r\n"
    end = "\r\n"

    def _question(self, axis: PolledAxis) -> StepQuestion[NewportReply]:
        echo = f"{axis.number}VE"
        return StepQuestion(f"\r\n{echo}\r\n".encode(), lambda reply: reply.echo == echo or None)

    def _echo(self, axis: PolledAxis, command: str) -> str:
        return command[: len(str(axis.number)) + 2]

    def _order(self, axis: PolledAxis, command: str, allowed: Callable[[], None] = anything) -> None:
        self._get(axis, "TE", "([@A-Z])")  # what a damaged line has left
        text = f"{axis.number}{command}{self.end}{axis.number}TE"
        (code,) = self._ask(axis, text, "([@A-Z])", allowed)
        if code != "@":
            reason = self._get(axis, f"TB{code}", r"\w? *(.*)")
            raise Rejected(f"{axis.name} at {self.address} refused {command}: {reason.lower()}", HOME, code)

    def _introduce(self) -> tuple[str, str, str]:
        named = {int(axis.number): axis for axis in self._axes}
        where, remedy = f"{self.address}: no answer from controllers", "check power, cables and addresses"
        versions = roll_call(named, lambda number: self._get(named[number], "VE", "(.+)"), where, remedy)
        stages = [self._get(axis, "ID?", "(.+)") for axis in self._axes]
        return "Newport SMC100", "; ".join(dict.fromkeys(versions)), "; ".join(stages)

    def _prepare(self, axis: PolledAxis) -> tuple[Travel, float]:
        return self._range_and_speed(axis)

    def _state(self, axis: PolledAxis) -> AxisState:
        """From the state, whose first digit is 0 or 1 without a reference, 2 in motion, 3 at rest."""
        errors, state = self._ask(axis, f"{axis.number}TS", "([0-9A-F]{4})([0-9A-F]{2})")
        if int(errors, 16) and self.trust.why is None:
            self.trust.lose(Alarm(f"{axis.name} at {self.address} has stopped with error {errors}", HOME, errors))
            self.trust.require()
        moving = state in ("1E", "1F", "28") or state.startswith("4")
        return AxisState(axis.to_unit(float(self._get(axis, "TP"))), moving, state >= "28")

    def _begin_homing(self, axis: PolledAxis, allowed: Callable[[], None]) -> None:
        """Only a controller without reference searches for it: one that has it is sent to its zero."""
        _, state = self._ask(axis, f"{axis.number}TS", "([0-9A-F]{4})([0-9A-F]{2})")
        self._order(axis, "PA0" if state >= "28" else "OR", allowed)


@dataclass(frozen=True)
class Esp301Axis(PolledAxis):
    """An axis of an ESP301."""

    number: Annotated[int, option("1", least=1, most=3)] = 1


@dataclass(frozen=True)
class Smc100Axis(PolledAxis):
    """An axis of SMC100 controllers on one line."""

    number: Annotated[int, option("1", least=1, most=31)] = 1


@dataclass(frozen=True, kw_only=True)
class Esp301Options(LineOptions):
    """Options of driver "esp301"."""

    makes = Esp301Stage
    parser = NewportParser
    axes: Annotated[tuple[Esp301Axis, ...], axes("number")]
    baud: Baud = 921600
    poll_s: PollInterval = 0.1


@dataclass(frozen=True, kw_only=True)
class Smc100Options(LineOptions):
    """Options of driver "smc100"."""

    makes = Smc100Stage
    parser = NewportParser
    axes: Annotated[tuple[Smc100Axis, ...], axes("number")]
    baud: Baud = 57600
    poll_s: PollInterval = 0.1
