"""Conditions of all devices, and positions of moving stages: read from the line only during a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivers.errors import DeviceError
from drivers.interfaces import Condition
from station.bench.axis_text import move_text

if TYPE_CHECKING:
    from station.bench.motions import Motion
    from station.bench.opening import Bench


@dataclass(frozen=True)
class DeviceState:
    """One device as a front end shows it; `places`: last reported positions of its axes."""

    name: str
    condition: Condition
    moving: bool = False
    places: Mapping[str, float] = field(default_factory=dict)


HOMING = "homing: keep clear"
NEAR = 0.02
"""Fraction of a move below which its speed is not estimated yet."""


@dataclass
class StageWatch:
    """The devices of a bench at each poll."""

    bench: Bench
    _last_places: dict[str, Mapping[str, float]] = field(default_factory=dict)
    _began: dict[str, tuple[Motion, Mapping[str, float]]] = field(default_factory=dict)

    def look(self) -> Sequence[DeviceState]:
        """Every device's condition; positions are read if the stage moves, else those last reported."""
        return [self._state(name, device.condition()) for name, device in self.bench.devices.items()]

    def _state(self, name: str, condition: Condition) -> DeviceState:
        motion = self.bench.motions.motion_of(name)
        if motion is None:
            ended = self.bench.motions.take_ended(name)
            if ended is not None and (ended.target or condition.usable):
                self._ask(name)
            elif ended is not None:
                self._last_places.pop(name, None)
            return DeviceState(name, condition, places=self._last_places.get(name, {}))
        if not motion.target:  # a controller does not answer while homing
            return DeviceState(name, Condition(HOMING, condition.usable, condition.remedy), moving=True)
        self._ask(name)
        here = self._last_places.get(name, {})
        return DeviceState(name, Condition(self._under_way(name, motion, here)), moving=True, places=here)

    def _ask(self, name: str) -> None:
        """Read the position from the line; if it does not answer, the last one is kept."""
        stage: Any = self.bench.devices[name]
        with suppress(DeviceError):
            self._last_places[name] = dict(stage.position())

    def _under_way(self, name: str, motion: Motion, here: Mapping[str, float]) -> str:
        if self._began.get(name, (None,))[0] is not motion:
            self._began[name] = motion, here
        begin = self._began[name][1]
        moves = [move_text(axis, here[axis], goal) for axis, goal in motion.target.items() if axis in here]
        elapsed_s = self.bench.clock.now_s() - motion.began_s
        left = []
        for axis, goal in motion.target.items():
            whole, gone = abs(goal - begin.get(axis, goal)), abs(here.get(axis, goal) - begin.get(axis, goal))
            if whole and gone > NEAR * whole:
                left.append(elapsed_s * (whole - gone) / gone)
        left_s = max(left, default=None)
        return "moving " + ", ".join([*moves, *([f"{left_s:.0f} s left"] if left_s is not None else [])])
