"""Alpaca focusers as the axes of one Stage: whole steps in, millimetres out.

The standard has no homing: the reported position is trusted, unless station.toml names an action that homes.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Literal

from drivers.alpaca.link import NOT_NOW, RESUME, AlpacaAddress, AlpacaLink, ServerOptions
from drivers.errors import BadConfiguration, Clock, Rejected
from drivers.interfaces import Identity, Travel
from drivers.making import MakerContext
from drivers.options import AxisName, Count, TimeLimit, axes, option, positive, text
from drivers.served_stage import ServedStage
from drivers.wire.connection import closed_after_errors

MM_PER_UM = 1e-3
PRECISION_STEPS = 2
HALT = "halt"


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


class AlpacaStage(ServedStage[FocuserAxis]):
    """A Stage of focusers of one Alpaca server."""

    def __init__(
        self, server: AlpacaAddress, axes: Sequence[AlpacaAxis], *, patience_s: float = 60.0, clock: Clock | None = None
    ) -> None:
        super().__init__(patience_s, clock)
        self._by_axis = {axis.name: FocuserAxis(axis, AlpacaLink(server, "focuser", axis.focuser)) for axis in axes}

    @property
    def address(self) -> str:
        return ", ".join(part.link.address for part in self._by_axis.values())

    def connect(self) -> Identity:
        """Connect every focuser and read step sizes and travel. Raises DeviceError."""
        self.close()
        with closed_after_errors(self):
            identities = [self._prepare(part) for part in self._by_axis.values()]
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
        super().close()
        for part in self._by_axis.values():
            part.link.close()

    @property
    def _is_open(self) -> bool:
        return all(part.link.is_open for part in self._by_axis.values())

    def travel(self) -> Mapping[str, Travel]:
        return {name: part.scale.travel for name, part in self._by_axis.items()} if self._is_open else {}

    def position(self) -> Mapping[str, float]:
        self._require_open()
        return {name: part.scale.to_unit(int(part.link.number_of("position"))) for name, part in self._by_axis.items()}

    def _parts(self, names: Collection[str] | None = None) -> list[FocuserAxis]:
        return [part for name, part in self._by_axis.items() if names is None or name in names]

    def _moves(self, part: FocuserAxis) -> bool:
        return bool(part.link.get("ismoving"))

    def _tolerance(self, name: str) -> float:
        return PRECISION_STEPS * self._by_axis[name].scale.unit_per_step

    def _begin_homing(self, part: FocuserAxis, allowed: Callable[[], None]) -> bool:
        if part.axis.home:
            self._order(part, "action", allowed, Action=part.axis.home, Parameters="")
        return bool(part.axis.home)

    def _begin_moves(self, target: Mapping[str, float], epoch: int, allowed: Callable[[], None]) -> None:
        parts = [self._by_axis[name] for name in target]
        for number, part in enumerate(parts):
            self._send(part, target[part.axis.name], parts[:number], epoch, allowed)

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

    def stop(self) -> None:
        """Stop and stay: sent at once, outside the client's queue, then confirmed. Raises DeviceError."""
        self._one_mover.stop()
        self._require_open()
        self._halt_all()
        for part in self._by_axis.values():
            part.link.put(HALT)

    def resume(self) -> None:
        """End a pause at the servers that offer that. Raises Held while a person still has to act, DeviceError."""
        self._require_open()
        for part in self._by_axis.values():
            if part.link.can_resume:
                part.link.put("action", Action=RESUME, Parameters="")
                self._finish([part], self.trust.epoch)

    def _halts(self) -> list[Callable[[], object]]:
        return [partial(part.link.preempt, HALT) for part in self._by_axis.values() if part.link.is_claimed]


@dataclass(frozen=True, kw_only=True)
class AlpacaStageOptions(ServerOptions):
    """Options of driver "alpaca_stage"."""

    axes: Annotated[tuple[AlpacaAxis, ...], axes("focuser")]
    patience_s: TimeLimit = 60.0

    def make(self, parts: MakerContext) -> AlpacaStage:
        return AlpacaStage(self.at, self.axes, patience_s=self.patience_s, clock=parts.clock)
