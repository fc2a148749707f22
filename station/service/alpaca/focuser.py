"""An axis of a stage as an Alpaca focuser: positions are whole micrometres from the low end of its travel."""

from collections.abc import Mapping
from typing import Any, cast

from drivers.errors import DeviceError
from drivers.interfaces import Condition, Stage, Travel
from station.service.alpaca.device import AlpacaDevice, Member, Task, absent, constant, refuse_operation
from station.service.alpaca.protocol import INVALID_VALUE, AlpacaError, Parameters
from station.service.bench_state import ServedBench

STEP_UM = 1.0
STEPS_PER_MM = 1000.0 / STEP_UM


class AxisFocuser(AlpacaDevice):
    """One axis of a stage of the bench, such as `z_mm`; its actions home the whole stage, and end a pause of it."""

    def __init__(self, served: ServedBench, number: int, stage: str, axis: str) -> None:
        assert served.bench is not None
        self._bench, self._stage_name, self._axis = served.bench, stage, axis
        self._stage = cast(Stage, served.bench.devices[stage])
        self._task = Task(served)
        self.actions = {"Home": self._home, **({"Resume": self._resume} if hasattr(self._stage, "resume") else {})}
        super().__init__(served, "focuser", number, f"{stage} {axis}", {stage: self._stage})

    def readable(self) -> Mapping[str, Member]:
        return {
            "absolute": constant(True),
            "ismoving": lambda given: self._is_moving(),
            "maxincrement": lambda given: self._last_step,
            "maxstep": lambda given: self._last_step,
            "position": lambda given: self._position(),
            "stepsize": constant(STEP_UM),
            "tempcomp": constant(False),
            "tempcompavailable": constant(False),
            **absent("temperature"),
        }

    def writable(self) -> Mapping[str, Member]:
        return {"halt": lambda given: self._halt(), "move": self._move, **absent("tempcomp")}

    def state(self) -> Mapping[str, Any]:
        state: dict[str, Any] = {"IsMoving": self._task.running}
        try:
            state["Position"] = self._position()
        except (AlpacaError, DeviceError):
            return state
        return state

    @property
    def _travel(self) -> Travel:
        return self._stage.travel()[self._axis]

    @property
    def _last_step(self) -> int:
        return int((self._travel.high - self._travel.low) * STEPS_PER_MM)

    def _is_moving(self) -> bool:
        self._task.check()
        if self._task.halted:  # the axis stands before its driver has reported the end of the move
            return self._stage.moving()
        return self._task.running or self._bench.motions.motion_of(self._stage_name) is not None

    def _position(self) -> int:
        motion = self._bench.motions.motion_of(self._stage_name)
        condition = self._stage.condition()
        if motion is not None and not motion.target:
            raise refuse_operation(f"{self._stage_name} is homing and has no position; wait for IsMoving")
        self._require_usable(condition)
        return round((self._stage.position()[self._axis] - self._travel.low) * STEPS_PER_MM)

    def _require_usable(self, condition: Condition) -> None:
        if not condition.usable:
            way = ": the action Home does that" if "home" in condition.remedy else ""
            raise refuse_operation(f"{condition.word}; {condition.remedy}{way}")

    def _move(self, given: Parameters) -> None:
        step = given.whole("Position")
        if not 0 <= step <= self._last_step:
            raise AlpacaError(INVALID_VALUE, f"Position must be between 0 and {self._last_step}; got {step}")
        self._require_usable(self._stage.condition())
        goal = min(self._travel.low + step / STEPS_PER_MM, self._travel.high)
        self._task.begin(
            f"a move of {self._axis}", lambda: self._bench.motions.move(self._stage_name, {self._axis: goal})
        )

    def _halt(self) -> None:
        self._task.halt(self._stage.stop)

    def _home(self, words: str) -> str:
        stops = self._bench.stops
        self._task.begin(
            f"the homing of {self._stage_name}",
            lambda: self._bench.motions.home(self._stage_name, lambda: self._bench.check_stops(stops)),
        )
        return ""

    def _resume(self, words: str) -> str:
        resume = cast(Any, self._stage).resume
        self._task.begin(f"the end of a pause of {self._stage_name}", resume)
        return ""
