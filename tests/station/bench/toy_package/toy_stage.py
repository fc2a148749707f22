"""A stage with an invented protocol: a driver of a package outside, with its parser and options, in one file.

`ID COMMAND*CRC` is answered by `ID ok VALUES*CRC` or `ID no REASON*CRC`; CRC is that of CCITT, of 16 bits, as four
hexadecimal digits. `!` stops the motor at once, also within a line.
"""

from __future__ import annotations

import itertools
from binascii import crc_hqx
from collections.abc import Callable, Mapping
from typing import NamedTuple

from toy_twin import ToyTwin

from drivers.clock import Clock
from drivers.errors import EmergencyStopped, MoveFailed, NoAnswer, NotHomed, Rejected
from drivers.homing_state import HOME, UNHOMED, Trust
from drivers.interfaces import Condition, Identity, Transport, Travel
from drivers.making import LineOptions, MakerContext
from drivers.move_checks import OneMover, check_arrival, check_target, left_still
from drivers.protocols.framing import LineSplitter
from drivers.wire.connection import anything, not_connected, opened
from drivers.wire.outgoing import URGENT_S

AXIS = "x_mm"
REPLY_S, POLL_S, TOLERANCE_MM = 0.3, 0.1, 0.002
TRIES = 5
STOP = b"!!!!\n"
"""Repeated, so that a lost byte does not leave the motor running."""


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


class ToyStage:
    """One axis of 200 mm that homes to its low end."""

    def __init__(self, transport: Transport[Reply], clock: Clock) -> None:
        self.clock, self.trust = clock, Trust()
        self._transport, self._mover = transport, OneMover()
        self._numbers = itertools.cycle(range(1, 1000))
        self._travel: dict[str, Travel] = {}
        self._speed = 1.0

    @property
    def address(self) -> str:
        return self._transport.address

    def connect(self) -> Identity:
        """Open the line, identify the stage, read its travel."""
        self._transport.close()
        self.trust.lose(UNHOMED)
        with opened(self._transport):
            model, firmware, serial = self._order("who", TRIES)
            low, high, self._speed = map(float, self._order("travel", TRIES))
        self._travel = {AXIS: Travel(low, high)}
        self.trust.why = UNHOMED
        return Identity(model, firmware, serial, self.address)

    def close(self) -> None:
        self.trust.lose(UNHOMED)
        self._transport.close()

    def condition(self) -> Condition:
        return self.trust.refusal(self._transport.is_open) or Condition("idle")

    def _order(self, command: str, tries: int = 1, allowed: Callable[[], None] = anything) -> list[str]:
        number = next(self._numbers)
        order = framed(f"{number} {command}")
        reply: Reply = self._transport.request(
            order, lambda reply: reply if reply.number == number else None, REPLY_S, tries, allowed
        )
        if not reply.accepted:
            raise Rejected(f"{self.address} refused {command!r}: {' '.join(reply.words)}", HOME)
        return reply.words

    def _where(self) -> tuple[str, float]:
        """State and position; a stage that has lost its reference is not trusted."""
        state, position = self._order("where", TRIES)
        if state == "unhomed" and self.trust.why is None:
            self.trust.lose(NotHomed(f"{self.address} has lost its reference", HOME))
        return state, float(position)

    def travel(self) -> Mapping[str, Travel]:
        return dict(self._travel)

    def position(self) -> Mapping[str, float]:
        return {AXIS: self._where()[1]}

    def moving(self) -> bool:
        return self._where()[0] in ("moving", "homing")

    def home(self, allowed: Callable[[], None] = anything) -> None:
        with self._mover as stops:
            if not self._transport.is_open:
                raise not_connected(self.address)
            epoch = self.trust.begin(self.trust.preemptions)
            may_go = self._mover.unless_stopped(stops, allowed, lambda: self.trust.undisturbed(epoch))
            with left_still(self._halt, self.emergency_stop, self.trust):
                self._order("home", allowed=may_go)
                length = sum(travel.high - travel.low for travel in self._travel.values())
                state, _ = self._finish(2 * length / self._speed + 5)
                if self._mover.stopped(stops) or state != "still":
                    raise MoveFailed(f"homing at {self.address} was interrupted", HOME)
            self.trust.give(epoch)

    def move_to(self, **target: float) -> None:
        with self._mover as stops:
            if not self._transport.is_open:
                raise not_connected(self.address)
            self.trust.require()
            check_target(target, self._travel)
            may_go = self._mover.unless_stopped(stops, self.trust.require)
            with left_still(self._halt, self.emergency_stop, self.trust):
                for name, goal in target.items():
                    way = abs(goal - self._where()[1])
                    self._order(f"go {goal:.4f}", allowed=may_go)
                    _, there = self._finish(2 * way / self._speed + 2)
                    self.trust.require()
                    check_arrival(name, goal, there, TOLERANCE_MM, self._mover.stopped(stops))

    def _finish(self, limit_s: float) -> tuple[str, float]:
        """State and position at rest. Raises NoAnswer after the limit, and an emergency stop."""
        deadline_s, epoch = self.clock.now_s() + limit_s, self.trust.epoch
        while (state := self._where())[0] in ("moving", "homing"):
            if self.clock.now_s() > deadline_s:
                raise NoAnswer(f"{self.address} still moves after {limit_s:.1f} s", "check speed and mechanics")
            self._transport.wait(lambda: self.trust.epoch != epoch, POLL_S)
        if self.trust.epoch != epoch:
            self.trust.require()
        return state

    def _halt(self) -> None:
        for _ in range(TRIES):  # a stop that is lost on a silent line is given again
            self._transport.write(STOP, within_s=URGENT_S)
            if self._where()[0] not in ("moving", "homing"):
                return
        raise NoAnswer(f"{self.address} does not stop", "switch it off")

    def stop(self) -> None:
        """Stop at once and keep the position."""
        self._mover.stop()
        self._halt()

    def emergency_stop(self) -> None:
        """Stop ahead of every lock; not trusted until homed."""
        self._mover.stop()
        error = EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}")
        self.trust.preempt(error)
        self._transport.preempt(STOP, error)


class ToyOptions(LineOptions):
    twin = ToyTwin

    def make(self, parts: MakerContext) -> ToyStage:
        return ToyStage(parts.wire(self.port, ToyParser, baud=self.baud), parts.clock)
