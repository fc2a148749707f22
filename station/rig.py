"""The bench as a run uses it: axes by name whichever stage has them, what every device says of itself, and mending."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

from drivers.errors import Alarm, DeviceError, EmergencyStopped, NotHomed, OutsideTravel, WasReset
from drivers.interfaces import Camera, Imu, Light, Rangefinder, Stage
from procedures.plan import Fact

if TYPE_CHECKING:
    from station.bench import Bench

POSITION_LOST = (Alarm, WasReset, NotHomed, EmergencyStopped)
NOT_THERE = ("not connected", "the folder is gone")
AT = "at_"
"""Before an axis' name: the fact where it is."""
LIGHT_LEVEL = "light_level"
DISTANCE = "distance_mm"


@dataclass(frozen=True)
class Snapshot:
    """What the devices said of themselves when a frame was taken; what a device did not tell is left out.

    Attributes
    ----------
    axes : by name, in the unit it carries
    distance_mm : from the rangefinder's housing
    silent : devices that did not answer, with what was wrong
    """

    axes: Mapping[str, float] = field(default_factory=dict)
    distance_mm: float | None = None
    light_level: float | None = None
    silent: Mapping[str, str] = field(default_factory=dict)

    def facts(self) -> dict[str, Fact]:
        """The same as facts of the moment."""
        told: dict[str, Fact] = {AT + name: value for name, value in self.axes.items()}
        if self.distance_mm is not None:
            told[DISTANCE] = self.distance_mm
        if self.light_level is not None:
            told[LIGHT_LEVEL] = self.light_level
        return told

    def record(self) -> dict[str, Any]:
        """For the session's journal."""
        record: dict[str, Any] = {"axes": dict(self.axes)}
        record |= {name: value for name, value in self.facts().items() if not name.startswith(AT)}
        return record | ({"silent": dict(self.silent)} if self.silent else {})


class Rig:
    """The devices of a bench that are in use, or none."""

    def __init__(self, bench: Bench | None) -> None:
        self.bench = bench
        self.left_out: set[str] = set()
        self._level: float | None = None

    def names(self) -> tuple[str, ...]:
        """Of the devices in use."""
        return tuple(name for name in (self.bench.devices if self.bench else ()) if name not in self.left_out)

    def _device(self, name: str) -> Any:
        return self.bench.devices[name] if self.bench and name in self.names() else None

    def stages(self) -> Iterable[Stage]:
        """All that moves."""
        devices = (self._device(name) for name in self.names())
        return [cast(Stage, device) for device in devices if hasattr(device, "move_to")]

    @property
    def imu(self) -> Imu | None:
        """The IMU on the camera, if there is one; so the others."""
        return cast("Imu | None", self._device("imu"))

    @property
    def camera(self) -> Camera | None:
        """What photographs."""
        return cast("Camera | None", self._device("camera"))

    @property
    def rangefinder(self) -> Rangefinder | None:
        """The laser."""
        return cast("Rangefinder | None", self._device("rangefinder"))

    @property
    def light(self) -> Light | None:
        """The lamp."""
        return cast("Light | None", self._device("light"))

    # --- connecting and mending

    def unconnected(self) -> list[str]:
        """Devices whose line is not open; a stage that has not homed yet is none of them."""
        conditions = {name: self._device(name).condition() for name in self.names()}
        return [name for name, told in conditions.items() if not told.usable and told.word in NOT_THERE]

    def connect(self, name: str) -> None:
        """Connect one device. Raises DeviceError."""
        assert self.bench is not None
        self.bench.identities[name] = self._device(name).connect()

    def mend(self, error: Exception) -> None:
        """What can be done before trying again: connect what was lost, home what lost its position."""
        for name in self.unconnected():
            self._device(name).close()
            self.connect(name)
        if isinstance(error, POSITION_LOST):
            self.home()

    # --- moving

    def home(self) -> None:
        """Every stage finds its reference. Raises DeviceError."""
        for stage in self.stages():
            stage.home()

    def _travels(self) -> dict[str, tuple[Stage, float, float]]:
        return {
            name: (stage, travel.low, travel.high) for stage in self.stages() for name, travel in stage.travel().items()
        }

    def axes(self) -> tuple[str, ...]:
        """Names of what can be moved."""
        return tuple(self._travels())

    def obstacle(self, moves: Mapping[str, float]) -> str | None:
        """Why the bench cannot make these moves by itself: "" where it has not the axes, else what is in the way."""
        travels = self._travels()
        if not moves or not all(name in travels for name in moves):
            return ""
        here = self.positions()
        for name, change in moves.items():
            _, low, high = travels[name]
            if not low <= here[name] + change <= high:
                return f"{name} goes from {low:g} to {high:g} and stands at {here[name]:.1f}"
        return None

    def positions(self) -> dict[str, float]:
        """Where the axes are now. Raises DeviceError."""
        return {name: value for stage in self.stages() for name, value in stage.position().items()}

    def axis_facts(self) -> dict[str, float]:
        """Where each axis is, and the ends of its travel, as facts. Raises DeviceError."""
        facts = {AT + name: value for name, value in self.positions().items()}
        for name, (_, low, high) in self._travels().items():
            facts |= {f"low_{name}": low, f"high_{name}": high}
        return facts

    def move_by(self, moves: Mapping[str, float]) -> None:
        """Move from here. Raises DeviceError."""
        here = self.positions()
        self.go_to({name: here[name] + change for name, change in moves.items()})

    def go_to(self, places: Mapping[str, float]) -> None:
        """Move to places; axes that the bench has not are left out. Raises DeviceError."""
        for stage in self.stages():
            own = {name: places[name] for name in stage.travel() if name in places}
            for name, place in own.items():
                if not stage.travel()[name].holds(place):
                    travel = stage.travel()[name]
                    raise OutsideTravel(
                        f"{name} goes from {travel.low:g} to {travel.high:g}; {place:.1f} was asked for",
                        "move the rail or the chart, and look again",
                    )
            if own:
                stage.move_to(**own)

    def set_light(self, level: float) -> None:
        """Set the lamp, if there is one. Raises DeviceError."""
        if self.light is not None:
            self.light.set_level(level)

    # --- what is so now

    def snapshot(self) -> Snapshot:
        """What every device says now; one that fails is named and left out."""
        axes: dict[str, float] = {}
        silent: dict[str, str] = {}
        for stage in self.stages():
            try:
                axes |= stage.position()
            except DeviceError as error:
                silent[stage.address] = error.reason
        distance_mm = None
        if self.rangefinder is not None:
            try:
                distance_mm = self.rangefinder.measure().distance_mm
            except DeviceError as error:
                silent["rangefinder"] = error.reason
        level = self.light.level() if self.light is not None else None
        return Snapshot(axes, distance_mm, level, silent)

    def announce(self, number: int) -> None:
        """The next frame is the session's shot of this number: a simulated one has its noise from that."""
        if self.bench is not None and self.bench.simulated is not None:
            self.bench.simulated.body.next_number = number

    def emergency_stop(self) -> None:
        """Everything stops, now."""
        if self.bench is not None:
            self.bench.emergency_stop()
