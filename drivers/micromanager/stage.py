"""Stages of Micro-Manager as one Stage: single axes and XY tables, micrometres in, millimetres or degrees out.

The core reports no travel, so station.toml gives it. If an adapter cannot home, its reported position is trusted
only if station.toml says so (`homes = false`: absolute encoders, piezos).
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from operator import methodcaller
from typing import Annotated, Any, Literal

from drivers.errors import Clock, EmergencyStopped, MoveFailed, NoAnswer, SystemClock
from drivers.interfaces import Caveat, Condition, Identity, Travel
from drivers.making import MakerContext
from drivers.micromanager.camera import (
    STAGE,
    XY_STAGE,
    Core,
    CoreOptions,
    Label,
    check_device,
    identity_text,
    translated_errors,
)
from drivers.move_checks import HOME, UNHOMED, OneMover, Trust, check_arrival, check_target, left_still
from drivers.options import AxisName, Patience, axes, interval, option, positive
from drivers.wire.connection import anything, not_connected

POLL_S = 0.02
REMEDY = "check its power and cable, then connect it again"
UNHOMABLE = "write homes = false for its axes if the reported position can be trusted"
STOP_S = 0.1
"""How long an emergency stop waits for busy adapters; their threads continue trying."""


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


class MicroManagerStage:
    """A Stage of devices in one Micro-Manager configuration."""

    def __init__(
        self, core: Core, axes: Sequence[MicroManagerAxis], *, patience_s: float = 60.0, clock: Clock | None = None
    ) -> None:
        self.clock = clock or SystemClock()
        self.trust = Trust()
        self._shared, self._axes, self._patience_s = core, tuple(axes), patience_s
        self._labels = tuple(dict.fromkeys(axis.device for axis in axes))
        self._core: Any = None
        self._one_mover = OneMover()
        self._unstoppable: tuple[str, ...] = ()

    @property
    def address(self) -> str:
        """The devices' labels and their configuration."""
        return f"{', '.join(self._labels)} in {self._shared.config.name}"

    def connect(self) -> Identity:
        """Load the configuration and check that the axes exist. Raises DeviceError."""
        self.close()
        core = self._shared.join(self)
        try:
            for axis in self._axes:
                kind, what = (XY_STAGE, "XY stage") if axis.part else (STAGE, "single axis")
                check_device(core, axis.device, (kind,), what, self._shared.config.name)
            # a harmless stop now shows whether the adapter supports it
            self._unstoppable = tuple(label for label in self._labels if not _halted(core, label))
        except BaseException:
            self._shared.leave(self)
            raise
        self._core = core
        models = "; ".join(identity_text(core, label) for label in self._labels)
        return Identity(f"Micro-Manager {models}", core.getVersionInfo(), "", self.address)

    def close(self) -> None:
        self.trust.lose(UNHOMED)
        self.trust.why = UNHOMED
        self._core = None
        self._shared.leave(self)

    def condition(self) -> Condition:
        """Whether it may move, and whether it can be stopped."""
        if (refusal := self.trust.refusal(self._core is not None)) is not None:
            return refusal
        if self._unstoppable:
            names = ", ".join(self._unstoppable)
            return Condition(
                "idle", caveat=Caveat(f"its adapter cannot stop {names}", "have a switch at hand that cuts its power")
            )
        return Condition("idle")

    def _open(self) -> Any:
        if (core := self._core) is None:
            raise not_connected(self.address)
        return core

    def travel(self) -> Mapping[str, Travel]:
        """The configured range of each axis."""
        return {axis.name: Travel(*axis.travel) for axis in self._axes}

    def position(self) -> Mapping[str, float]:
        core = self._open()
        with self._asked():
            return {axis.name: axis.to_unit(_read(core, axis)) for axis in self._axes}

    def moving(self) -> bool:
        """Whether any device reports that it is busy. Raises DeviceError."""
        core = self._open()
        with self._asked():
            return any(core.deviceBusy(label) for label in self._labels)

    def _asked(self) -> AbstractContextManager[None]:
        return translated_errors(self.address, REMEDY)

    # --- moving

    def home(self, allowed: Callable[[], None] = anything) -> None:
        """Home the devices that have a reference. Raises DeviceError."""
        with self._one_mover as stops:
            self._open()
            epoch = self.trust.begin(self.trust.preemptions)
            undisturbed = self._one_mover.unless_stopped(stops, allowed, partial(self.trust.undisturbed, epoch))
            with self._left_still():
                for label in dict.fromkeys(axis.device for axis in self._axes if axis.homes):
                    self._order(methodcaller("home", label), undisturbed, UNHOMABLE)
                    self._finish([label], epoch)
                undisturbed()
                self._check_inside()
            self.trust.give(epoch)

    def _check_inside(self) -> None:
        for axis in self._axes:
            here, (low, high) = self.position()[axis.name], axis.travel
            if not low - axis.tolerance <= here <= high + axis.tolerance:
                raise MoveFailed(
                    f"{axis.name} is at {here:.4f}, outside its travel {low:g} .. {high:g}",
                    "correct zero, direction or travel in station.toml, or move it inside by hand",
                )

    def move_to(self, **target: float) -> None:
        with self._one_mover as stops:
            self._open()
            self.trust.require()
            check_target(target, self.travel())
            epoch, may_go = self.trust.epoch, self._one_mover.unless_stopped(stops, self.trust.require)
            labels = [label for label in self._labels if any(axis.name in target for axis in self._of(label))]
            with self._left_still():
                for label in labels:
                    self._send(label, target, may_go)
                self._finish(labels, epoch)
                there, stopped = self.position(), self._one_mover.stopped(stops)
                for axis in self._axes:
                    if axis.name in target:
                        check_arrival(axis.name, target[axis.name], there[axis.name], axis.tolerance, stopped)

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
            self._halt_all(core)
            self.trust.require()

    def _finish(self, labels: Sequence[str], epoch: int) -> None:
        """Wait until these devices are still. Raises NoAnswer after the time limit."""
        core, deadline_s = self._open(), self.clock.now_s() + self._patience_s
        with self._asked():
            while any(core.deviceBusy(label) for label in labels):
                self.trust.undisturbed(epoch)
                if self.clock.now_s() > deadline_s:
                    reason = f"{self.address} still moves after {self._patience_s:g} s"
                    raise NoAnswer(reason, "check its mechanics, or raise patience_s")
                self.clock.sleep(POLL_S)
        self.trust.undisturbed(epoch)

    def _left_still(self) -> AbstractContextManager[None]:
        return left_still(partial(self._halt_all, self._open()), self.emergency_stop, self.trust)

    def stop(self) -> None:
        """Stop and stay. Raises Rejected if an adapter cannot stop."""
        self._one_mover.stop()
        core = self._open()
        with translated_errors(self.address, "cut its power"):
            for label in self._labels:
                core.stop(label)

    def emergency_stop(self) -> None:
        """Stop all devices simultaneously; unsafe until homed."""
        self._one_mover.stop()
        self.trust.preempt(EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}"))
        if (core := self._core) is not None:
            self._halt_all(core)

    def _halt_all(self, core: Any) -> None:
        threads = [threading.Thread(target=_halted, args=(core, label), daemon=True) for label in self._labels]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(STOP_S / len(threads))


def _halted(core: Any, label: str) -> bool:
    """Whether the device accepted a stop."""
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
    patience_s: Patience = 60.0

    def make(self, parts: MakerContext) -> MicroManagerStage:
        return MicroManagerStage(self.core(parts), self.axes, patience_s=self.patience_s, clock=parts.clock)
