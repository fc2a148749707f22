"""Alpaca focusers as the axes of one Stage: whole steps in, millimetres out.

The standard has no homing: the reported position is trusted, unless station.toml names an action that homes.
"""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Literal

from drivers.alpaca.link import NOT_NOW, RESUME, AlpacaAddress, AlpacaLink, ServerOptions
from drivers.errors import BadConfiguration, Clock, DeviceError, EmergencyStopped, NoAnswer, Rejected, SystemClock
from drivers.interfaces import Condition, Identity, Travel
from drivers.making import MakerContext
from drivers.move_checks import HOME, UNHOMED, OneMover, Trust, check_arrival, check_target, left_still
from drivers.options import AxisName, Count, Patience, axes, option, positive, text
from drivers.wire.connection import anything, not_connected

POLL_S = 0.05
MM_PER_UM = 1e-3
PRECISION_STEPS = 2
HALT, HALTED_S = "halt", 0.25
"""How long a stop waits for slow servers; its threads continue trying."""


@dataclass(frozen=True)
class AlpacaAxis:
    """One axis: its name with the unit, and the number of its focuser.

    unit_per_step : None uses the step size in micrometres that the focuser reports
    zero : the value at step 0
    direction : -1 if steps count in the opposite direction
    home : the action that homes it; "" trusts the reported position
    """

    name: AxisName
    focuser: Count
    unit_per_step: Annotated[float, positive("0.001")] | None = None
    zero: Annotated[float, option("0.0")] = 0.0
    direction: Literal[1, -1] = 1
    home: Annotated[str, text('"Home"', "the name of the focuser's action that homes it in quotes")] = ""


@dataclass(frozen=True)
class Scale:
    """Conversion between steps and the axis' unit, and the number of steps."""

    axis: AlpacaAxis
    unit_per_step: float
    last: int

    def to_step(self, value: float) -> int:
        return round((value - self.axis.zero) / (self.axis.direction * self.unit_per_step))

    def to_unit(self, step: float) -> float:
        return self.axis.zero + step * self.axis.direction * self.unit_per_step

    @property
    def travel(self) -> Travel:
        """From the first step to the last."""
        ends = (self.to_unit(0), self.to_unit(self.last))
        return Travel(min(ends), max(ends))


@dataclass
class FocuserAxis:
    """An axis, the connection to its focuser, and, once connected, its scale."""

    axis: AlpacaAxis
    link: AlpacaLink
    scale: Scale = field(init=False)


class AlpacaStage:
    """A Stage of focusers of one Alpaca server."""

    def __init__(
        self, server: AlpacaAddress, axes: Sequence[AlpacaAxis], *, patience_s: float = 60.0, clock: Clock | None = None
    ) -> None:
        self.clock = clock or SystemClock()
        self.trust = Trust()
        self._parts = {axis.name: FocuserAxis(axis, AlpacaLink(server, "focuser", axis.focuser)) for axis in axes}
        self._patience_s = patience_s
        self._one_mover = OneMover()

    @property
    def address(self) -> str:
        return ", ".join(part.link.address for part in self._parts.values())

    def connect(self) -> Identity:
        """Connect every focuser and read step sizes and travel. Raises DeviceError."""
        self.close()
        try:
            identities = [self._prepare(part) for part in self._parts.values()]
        except BaseException:
            self.close()
            raise
        models = "; ".join(dict.fromkeys(identity.model for identity in identities))
        return Identity(models, identities[0].firmware, "", self.address)

    def _prepare(self, part: FocuserAxis) -> Identity:
        link, axis, identity = part.link, part.axis, part.link.open()
        absolute, last = link.get("absolute"), int(link.number_of("maxstep"))
        if not absolute:
            raise BadConfiguration(f"{part.link.address} supports relative moves only", "use an absolute focuser")
        unit = axis.unit_per_step
        if unit is None:
            unit = MM_PER_UM * link.number_of("stepsize")
        if not unit > 0 or last < 1:
            reason = f"{part.link.address} reports steps of {unit:g} mm and a largest step number of {last}"
            raise BadConfiguration(reason, "write unit_per_step for its axis")
        part.scale = Scale(axis, unit, last)
        return identity

    def close(self) -> None:
        self.trust.lose(UNHOMED)
        self.trust.why = UNHOMED
        for part in self._parts.values():
            part.link.close()

    @property
    def _open(self) -> bool:
        """Whether every focuser is connected."""
        return all(part.link.is_open for part in self._parts.values())

    def condition(self) -> Condition:
        return self.trust.refusal(self._open) or Condition("idle")

    def _require_open(self) -> None:
        if not self._open:
            raise not_connected(self.address)

    def travel(self) -> Mapping[str, Travel]:
        """The range of each axis; known once connected."""
        return {name: part.scale.travel for name, part in self._parts.items()} if self._open else {}

    def position(self) -> Mapping[str, float]:
        self._require_open()
        return {name: part.scale.to_unit(int(part.link.number_of("position"))) for name, part in self._parts.items()}

    def moving(self) -> bool:
        self._require_open()
        return any(_moving(part) for part in self._parts.values())

    # --- moving

    def home(self, allowed: Callable[[], None] = anything) -> None:
        """Call the homing action of every axis that has one, one after another. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_open()
            epoch = self.trust.begin(self.trust.preemptions)
            undisturbed = self._one_mover.unless_stopped(stops, allowed, partial(self.trust.undisturbed, epoch))
            with self._left_still(epoch):
                for part in self._parts.values():
                    if part.axis.home:
                        self._order(part, "action", undisturbed, Action=part.axis.home, Parameters="")
                        self._finish([part], epoch)
                undisturbed()
                self.position()  # a focuser without a known position raises here
            self.trust.give(epoch)

    def move_to(self, **target: float) -> None:
        """Move the axes simultaneously and return when all are still. Raises DeviceError."""
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
        self, part: FocuserAxis, value: float, begun: Sequence[FocuserAxis], epoch: int, allowed: Callable[[], None]
    ) -> None:  # fmt: skip
        """Move one axis; retry while a server that moves one axis at a time refuses because another moves."""
        step = min(max(part.scale.to_step(value), 0), part.scale.last)
        try:
            self._order(part, "move", allowed, Position=step)
        except Rejected as error:
            if not begun or error.code != NOT_NOW:
                raise
            self._finish(begun, epoch)
            self._order(part, "move", allowed, Position=step)

    def _order(self, part: FocuserAxis, order: str, allowed: Callable[[], None], **values: object) -> None:
        """Give an order if it is allowed; an error if a stop, which may have overtaken it, came meanwhile."""
        allowed()
        part.link.put(order, **values)
        allowed()

    def _finish(self, parts: Sequence[FocuserAxis], epoch: int) -> None:
        """Wait until these are still. Raises NoAnswer after the time limit."""
        deadline_s = self.clock.now_s() + self._patience_s
        while any(_moving(part) for part in parts):
            self.trust.undisturbed(epoch)
            if self.clock.now_s() > deadline_s:
                reason = f"{self.address} still moves after {self._patience_s:g} s"
                raise NoAnswer(reason, "check its mechanics, or raise patience_s")
            self.clock.sleep(POLL_S)
        self.trust.undisturbed(epoch)

    @contextmanager
    def _left_still(self, epoch: int) -> Iterator[None]:
        with left_still(self._halt_all, self.emergency_stop, self.trust):
            try:
                yield
            except DeviceError:
                self.trust.undisturbed(epoch)  # report an error caused by a stop as that stop
                raise

    def stop(self) -> None:
        """Stop and stay: sent at once, outside the client's queue, then confirmed. Raises DeviceError."""
        self._one_mover.stop()
        self._require_open()
        self._halt_all()
        for part in self._parts.values():
            part.link.put(HALT)

    def resume(self) -> None:
        """End a pause at the servers that offer that. Raises Held while a person still has to act, DeviceError."""
        self._require_open()
        for part in self._parts.values():
            if part.link.can_resume:
                part.link.put("action", Action=RESUME, Parameters="")
                self._finish([part], self.trust.epoch)

    def emergency_stop(self) -> None:
        """Halt all focusers simultaneously, without waiting for pending requests; unsafe until homed."""
        self._one_mover.stop()
        self.trust.preempt(EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}"))
        self._halt_all()

    def _halt_all(self) -> None:
        links = [part.link for part in self._parts.values() if part.link.is_claimed]
        threads = [threading.Thread(target=link.preempt, args=(HALT,), name="halt", daemon=True) for link in links]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(HALTED_S / len(threads))


def _moving(part: FocuserAxis) -> bool:
    return bool(part.link.get("ismoving"))


@dataclass(frozen=True, kw_only=True)
class AlpacaStageOptions(ServerOptions):
    """Options of driver "alpaca_stage"."""

    axes: Annotated[tuple[AlpacaAxis, ...], axes("focuser")]
    patience_s: Patience = 60.0

    def make(self, parts: MakerContext) -> AlpacaStage:
        return AlpacaStage(self.at, self.axes, patience_s=self.patience_s, clock=parts.clock)
