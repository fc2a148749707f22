"""How the devices are, and how far those are that move: asked of the wires only while something does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivers.errors import DeviceError
from drivers.interfaces import Condition
from station.bench.axis_words import way_in_words

if TYPE_CHECKING:
    from station.bench.motions import Motion
    from station.bench.opening import Bench


@dataclass(frozen=True)
class DeviceState:
    """One device as a front end shows it; `places`: where its axes are, as the wire told it last."""

    name: str
    condition: Condition
    moving: bool = False
    places: Mapping[str, float] = field(default_factory=dict)


HOMING = "homing: keep clear"
NEAR = 0.02
"""Share of a way below which its speed is not told yet."""


@dataclass
class StageWatch:
    """The devices of a bench as they are at each look."""

    bench: Bench
    _heard: dict[str, Mapping[str, float]] = field(default_factory=dict)
    _began: dict[str, tuple[Motion, Mapping[str, float]]] = field(default_factory=dict)

    def look(self) -> Sequence[DeviceState]:
        """Every device's condition; of a stage that moves where it is, else where it was told to be last."""
        return [self._state(name, device.condition()) for name, device in self.bench.devices.items()]

    def _state(self, name: str, condition: Condition) -> DeviceState:
        motion = self.bench.motions.of(name)
        if motion is None:
            self._after(name, self.bench.motions.take_ended(name), condition)
            return DeviceState(name, condition, places=self._heard.get(name, {}))
        if not motion.target:  # a controller that homes answers no question
            return DeviceState(name, Condition(HOMING, condition.usable, condition.remedy), moving=True)
        self._ask(name)
        here = self._heard.get(name, {})
        return DeviceState(name, Condition(self._under_way(name, motion, here)), moving=True, places=here)

    def _after(self, name: str, ended: Motion | None, condition: Condition) -> None:
        """Where it came to stand; before it has homed, what a controller tells means nothing."""
        if ended is not None and (ended.target or condition.usable):
            self._ask(name)
        elif ended is not None:
            self._heard.pop(name, None)

    def _ask(self, name: str) -> None:
        """Where it is by the wire; what does not answer leaves what was told last."""
        stage: Any = self.bench.devices[name]
        with suppress(DeviceError):
            self._heard[name] = dict(stage.position())

    def _under_way(self, name: str, motion: Motion, here: Mapping[str, float]) -> str:
        if self._began.get(name, (None,))[0] is not motion:
            self._began[name] = motion, here
        begin = self._began[name][1]
        ways = [way_in_words(axis, here[axis], goal) for axis, goal in motion.target.items() if axis in here]
        left_s = self._left_s(motion, begin, here)
        return "moving " + ", ".join([*ways, *([f"{left_s:.0f} s left"] if left_s is not None else [])])

    def _left_s(self, motion: Motion, begin: Mapping[str, float], here: Mapping[str, float]) -> float | None:
        """The time that the longest way takes if it goes on as fast; None where that cannot be told yet."""
        elapsed_s = self.bench.clock.now_s() - motion.began_s
        left = []
        for axis, goal in motion.target.items():
            whole, gone = abs(goal - begin.get(axis, goal)), abs(here.get(axis, goal) - begin.get(axis, goal))
            if whole and gone > NEAR * whole:
                left.append(elapsed_s * (whole - gone) / gone)
        return max(left, default=None)
