"""Stages of Micro-Manager as one Stage: single axes and XY tables, micrometres in, millimetres or degrees out.

The core reports no travel, so station.toml gives it. If an adapter cannot home, its reported position is trusted
only if station.toml says so (`homes = false`: absolute encoders, piezos).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import methodcaller
from typing import Annotated, Any, Literal

from drivers.errors import Clock, MoveFailed
from drivers.interfaces import Caveat, Condition, Travel
from drivers.making import MakerContext
from drivers.micromanager.camera import STAGE, XY_STAGE, Core, CoreDevice, CoreOptions, Label, translated_errors
from drivers.options import AxisName, TimeLimit, axes, interval, option, positive
from drivers.served_stage import ServedStage

REMEDY = "check its power and cable, then connect it again"
UNHOMABLE = "write homes = false for its axes if the reported position can be trusted"


@dataclass(frozen=True)
class MicroManagerAxis:
    """One axis: its name with the unit, the label of its device, its travel in the unit.

    part : "x" or "y" of an XY table, "" of a single axis
    zero : the value at the device's position 0
    unit_per_um : in the name's unit
    direction : -1 if the device counts in the opposite direction
    homes : whether `home` sends the device to its reference; otherwise the reported position is trusted
    tolerance : largest deviation from the target after a move
    """

    name: AxisName
    device: Label
    travel: Annotated[tuple[float, float], interval("[0.0, 25.0]")]
    part: Literal["", "x", "y"] = ""
    zero: Annotated[float, option("0.0")] = 0.0
    unit_per_um: Annotated[float, positive("0.001")] = 0.001
    direction: Literal[1, -1] = 1
    homes: bool = True
    tolerance: Annotated[float, positive("0.005")] = 0.005

    def to_um(self, value: float) -> float:
        """The device's position of a value."""
        return (value - self.zero) / (self.direction * self.unit_per_um)

    def to_unit(self, um: float) -> float:
        """The value of a device's position."""
        return self.zero + um * self.direction * self.unit_per_um


class MicroManagerStage(CoreDevice, ServedStage[str]):
    """A Stage of devices in one Micro-Manager configuration."""

    poll_s, halted_s = 0.02, 0.1

    def __init__(
        self, core: Core, axes: Sequence[MicroManagerAxis], *, patience_s: float = 60.0, clock: Clock | None = None
    ) -> None:
        kinds = {axis.device: (XY_STAGE, "XY stage") if axis.part else (STAGE, "single axis") for axis in axes}
        CoreDevice.__init__(self, core, kinds)
        ServedStage.__init__(self, patience_s, clock)
        self._axes = tuple(axes)
        self._unstoppable: tuple[str, ...] = ()

    def _prepare(self, core: Any) -> None:
        # a harmless stop now shows whether the adapter supports it
        self._unstoppable = tuple(label for label in self._labels if not _halted(core, label))

    def close(self) -> None:
        ServedStage.close(self)
        CoreDevice.close(self)

    @property
    def _is_open(self) -> bool:
        return self._core is not None

    def condition(self) -> Condition:
        """Whether it may move, and whether it can be stopped."""
        condition = ServedStage.condition(self)
        if not condition.usable or not self._unstoppable:
            return condition
        names = ", ".join(self._unstoppable)
        caveat = Caveat(f"its adapter cannot stop {names}", "have a switch at hand that cuts its power")
        return Condition("idle", caveat=caveat)

    def travel(self) -> Mapping[str, Travel]:
        return {axis.name: Travel(*axis.travel) for axis in self._axes}

    def position(self) -> Mapping[str, float]:
        core = self._open()
        with translated_errors(self.address, REMEDY):
            return {axis.name: axis.to_unit(_read(core, axis)) for axis in self._axes}

    def _parts(self, names: Collection[str] | None = None) -> list[str]:
        return list(dict.fromkeys(axis.device for axis in self._axes if names is None or axis.name in names))

    def _moves(self, part: str) -> bool:
        core = self._open()
        with translated_errors(self.address, REMEDY):
            return bool(core.deviceBusy(part))

    def _tolerance(self, name: str) -> float:
        return next(axis.tolerance for axis in self._axes if axis.name == name)

    # --- moving

    def _begin_homing(self, part: str, allowed: Callable[[], None]) -> bool:
        homes = any(axis.homes for axis in self._of(part))
        if homes:
            self._order(methodcaller("home", part), allowed, UNHOMABLE)
        return homes

    def _check_homed(self) -> None:
        for axis in self._axes:
            here, (low, high) = self.position()[axis.name], axis.travel
            if not low - axis.tolerance <= here <= high + axis.tolerance:
                raise MoveFailed(
                    f"{axis.name} is at {here:.4f}, outside its travel {low:g} .. {high:g}",
                    "correct zero, direction or travel in station.toml, or move it inside by hand",
                )

    def _begin_moves(self, target: Mapping[str, float], epoch: int, allowed: Callable[[], None]) -> None:
        for label in self._parts(target):
            self._send(label, target, allowed)

    def _of(self, label: str) -> list[MicroManagerAxis]:
        return [axis for axis in self._axes if axis.device == label]

    def _send(self, label: str, target: Mapping[str, float], allowed: Callable[[], None]) -> None:
        """Move one device; an axis of an XY table without a target stays where it is."""
        axes = {axis.part: axis for axis in self._of(label) if axis.name in target}
        goal = {part: axis.to_um(target[axis.name]) for part, axis in axes.items()}

        def order(core: Any) -> None:
            if "" in goal:
                core.setPosition(label, goal[""])
                return
            x = goal["x"] if "x" in goal else core.getXPosition(label)
            y = goal["y"] if "y" in goal else core.getYPosition(label)
            core.setXYPosition(label, x, y)

        self._order(order, allowed)

    def _order(self, order: Callable[[Any], None], allowed: Callable[[], None], remedy: str = REMEDY) -> None:
        """Give an order if it is allowed; cancel it if an emergency stop came meanwhile. Raises DeviceError."""
        core, preemptions = self._open(), self.trust.preemptions
        allowed()
        with translated_errors(self.address, remedy):
            order(core)
        if self.trust.preemptions != preemptions:
            self._halt_all()
            self.trust.require()

    def stop(self) -> None:
        """Stop and stay. Raises Rejected if an adapter cannot stop."""
        self._one_mover.stop()
        core = self._open()
        with translated_errors(self.address, "cut its power"):
            for label in self._labels:
                core.stop(label)

    def _halts(self) -> list[Callable[[], object]]:
        core = self._core
        return [] if core is None else [partial(_halted, core, label) for label in self._labels]


def _halted(core: Any, label: str) -> bool:
    try:
        core.stop(label)
    except RuntimeError:
        return False
    return True


def _read(core: Any, axis: MicroManagerAxis) -> float:
    read = {"": core.getPosition, "x": core.getXPosition, "y": core.getYPosition}[axis.part]
    return float(read(axis.device))


@dataclass(frozen=True, kw_only=True)
class MicroManagerStageOptions(CoreOptions):
    """Options of driver "micromanager_stage"."""

    axes: Annotated[tuple[MicroManagerAxis, ...], axes("device", "part")]
    patience_s: TimeLimit = 60.0

    def make(self, parts: MakerContext) -> MicroManagerStage:
        return MicroManagerStage(self.core(parts), self.axes, patience_s=self.patience_s, clock=parts.clock)
