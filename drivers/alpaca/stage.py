"""Alpaca focusers as the axes of one Stage: whole steps in, millimetres out.

A focuser has no homing in the standard: what it tells is believed, unless station.toml names an action that homes it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

from drivers.alpaca.link import NOT_NOW, AlpacaLink, AlpacaServer
from drivers.clock import Clock, SystemClock
from drivers.errors import BadConfiguration, DeviceError, EmergencyStopped, NoAnswer, Rejected
from drivers.homing_state import HOME, UNHOMED, Trust
from drivers.interfaces import Condition, Identity, Travel
from drivers.move_checks import OneMover, check_arrival, check_target, left_still
from drivers.wire.connection import anything, not_connected

POLL_S = 0.05
MM_PER_UM = 1e-3
PRECISION_STEPS = 2
HALT, HALTED_S = "halt", 0.25
"""How long a stop waits for servers that are slow to answer; its threads go on trying."""


@dataclass(frozen=True)
class AlpacaAxis:
    """One axis: its name with the unit, and the number of the focuser it is.

    Attributes
    ----------
    unit_per_step : None takes the step that the focuser tells, in micrometres
    zero : the value at step 0
    direction : -1 where steps count the other way
    home : the action that homes it; "" believes the position that it tells
    """

    name: str
    focuser: int
    unit_per_step: float | None = None
    zero: float = 0.0
    direction: int = 1
    home: str = ""


@dataclass(frozen=True)
class Scale:
    """What an axis' steps mean, and how many there are."""

    axis: AlpacaAxis
    unit_per_step: float
    last: int

    def to_step(self, value: float) -> int:
        """The nearest step."""
        return round((value - self.axis.zero) / (self.axis.direction * self.unit_per_step))

    def to_unit(self, step: float) -> float:
        """Where that step is."""
        return self.axis.zero + step * self.axis.direction * self.unit_per_step

    @property
    def travel(self) -> Travel:
        """From the first step to the last."""
        ends = (self.to_unit(0), self.to_unit(self.last))
        return Travel(min(ends), max(ends))


@dataclass
class Part:
    """An axis, the way to its focuser, and, once connected, its scale."""

    axis: AlpacaAxis
    link: AlpacaLink
    scale: Scale = field(init=False)


class AlpacaStage:
    """A Stage of focusers of one Alpaca server."""

    def __init__(
        self, server: AlpacaServer, axes: Sequence[AlpacaAxis], *, patience_s: float = 60.0, clock: Clock | None = None
    ) -> None:
        self.clock = clock or SystemClock()
        self.trust = Trust()
        self._parts = {axis.name: Part(axis, AlpacaLink(server, "focuser", axis.focuser)) for axis in axes}
        self._patience_s = patience_s
        self._one_mover = OneMover()
        self._open = False

    @property
    def address(self) -> str:
        """The focusers and their server."""
        return ", ".join(part.link.address for part in self._parts.values())

    def connect(self) -> Identity:
        """Connect every focuser, and ask for steps and travel. Raises DeviceError."""
        self.close()
        told = [self._prepare(part) for part in self._parts.values()]
        self._open = True
        models = "; ".join(dict.fromkeys(one.model for one in told))
        return Identity(models, told[0].firmware, "", self.address)

    def _prepare(self, part: Part) -> Identity:
        identity, axis = part.link.open(), part.axis
        device = part.link.device
        with part.link.asked():
            absolute, last = bool(device.Absolute), int(device.MaxStep)
        if not absolute:
            raise BadConfiguration(f"{part.link.address} moves by steps only, not to places", "use an absolute focuser")
        unit = axis.unit_per_step
        if unit is None:
            with part.link.asked():
                unit = MM_PER_UM * float(device.StepSize)
        if not unit > 0 or last < 1:
            told = f"{part.link.address} tells steps of {unit:g} mm up to number {last}"
            raise BadConfiguration(told, "write unit_per_step for its axis")
        part.scale = Scale(axis, unit, last)
        return identity

    def close(self) -> None:
        """Leave the focusers."""
        self._open = False
        self.trust.lose(UNHOMED)
        self.trust.why = UNHOMED
        for part in self._parts.values():
            part.link.close()

    def condition(self) -> Condition:
        """Whether it may move."""
        return self.trust.refusal(self._open) or Condition("idle")

    def _require_open(self) -> None:
        if not self._open:
            raise not_connected(self.address)

    def travel(self) -> Mapping[str, Travel]:
        """The range of each axis; known once connected."""
        return {name: part.scale.travel for name, part in self._parts.items()} if self._open else {}

    def position(self) -> Mapping[str, float]:
        """Where the axes are now. Raises DeviceError."""
        self._require_open()
        return {name: part.scale.to_unit(_position(part)) for name, part in self._parts.items()}

    def moving(self) -> bool:
        """Whether any axis moves. Raises DeviceError."""
        self._require_open()
        return any(_moving(part) for part in self._parts.values())

    # --- moving

    def home(self, allowed: Callable[[], None] = anything) -> None:
        """Call the action of every axis that has one, one after another. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_open()
            epoch = self.trust.begin(self.trust.shouts)
            undisturbed = self._one_mover.unless_stopped(stops, allowed, partial(self.trust.undisturbed, epoch))
            with self._left_still(epoch):
                for part in self._parts.values():
                    if part.axis.home:
                        self._order(part, lambda part=part: part.link.device.Action(part.axis.home, ""), undisturbed)  # type: ignore[misc]
                        self._finish([part], epoch)
                undisturbed()
                self.position()  # a focuser that knows no place says so here
            self.trust.give(epoch)

    def move_to(self, **target: float) -> None:
        """Send the axes there side by side, and return when all are still. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_open()
            self.trust.require()
            check_target(target, self.travel())
            epoch, may_go = self.trust.epoch, self._one_mover.unless_stopped(stops, self.trust.require)
            parts = [self._parts[name] for name in target]
            with self._left_still(epoch):
                for number, part in enumerate(parts):
                    self._send(part, target[part.axis.name], parts[:number], epoch, may_go)
                self._finish(parts, epoch)
                there, stopped = self.position(), self._one_mover.stopped(stops)
                for part in parts:
                    name, tolerance = part.axis.name, PRECISION_STEPS * part.scale.unit_per_step
                    check_arrival(name, target[name], there[name], tolerance, stopped)

    def _send(
        self, part: Part, value: float, begun: Sequence[Part], epoch: int, allowed: Callable[[], None]
    ) -> None:  # fmt: skip
        """Send one axis; a server that moves one at a time refuses while others move, and is asked again."""
        step = min(max(part.scale.to_step(value), 0), part.scale.last)
        try:
            self._order(part, lambda: part.link.device.Move(step), allowed)
        except Rejected as error:
            if not begun or error.code != NOT_NOW:
                raise
            self._finish(begun, epoch)
            self._order(part, lambda: part.link.device.Move(step), allowed)

    def _order(self, part: Part, order: Callable[[], object], allowed: Callable[[], None]) -> None:
        """Give an order if it is allowed; one that an emergency stop overtook is taken back. Raises DeviceError."""
        shouts = self.trust.shouts
        allowed()
        with part.link.asked():
            order()
        if self.trust.shouts != shouts:
            self._halt_all()
            self.trust.require()

    def _finish(self, parts: Sequence[Part], epoch: int) -> None:
        """Wait until these are still. Raises NoAnswer past the patience."""
        deadline_s = self.clock.now_s() + self._patience_s
        while any(_moving(part) for part in parts):
            self.trust.undisturbed(epoch)
            if self.clock.now_s() > deadline_s:
                told = f"{self.address} still moves after {self._patience_s:g} s"
                raise NoAnswer(told, "check its mechanics, or raise patience_s")
            self.clock.sleep(POLL_S)
        self.trust.undisturbed(epoch)

    @contextmanager
    def _left_still(self, epoch: int) -> Iterator[None]:
        with left_still(self._halt_all, self.emergency_stop, self.trust):
            try:
                yield
            except DeviceError:
                self.trust.undisturbed(epoch)  # what failed because everything was stopped is told as that
                raise

    def stop(self) -> None:
        """Stay where it is: told at once, past the client's queue, then confirmed. Raises DeviceError."""
        self._one_mover.stop()
        self._require_open()
        self._halt_all()
        for part in self._parts.values():
            with part.link.asked():
                part.link.device.Halt()

    def emergency_stop(self) -> None:
        """Halt all focusers side by side, past whatever is being asked; unsafe until homed."""
        self._one_mover.stop()
        self.trust.shout(EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}"))
        if self._open:
            self._halt_all()

    def _halt_all(self) -> None:
        links = [part.link for part in self._parts.values()]
        threads = [threading.Thread(target=link.shout, args=(HALT,), name="halt", daemon=True) for link in links]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(HALTED_S / len(threads))


def _position(part: Part) -> int:
    with part.link.asked():
        return int(part.link.device.Position)


def _moving(part: Part) -> bool:
    with part.link.asked():
        return bool(part.link.device.IsMoving)
