"""The devices of a run: axes by name, the state of every device, and recovery after errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, cast

from drivers.errors import Alarm, DeviceError, EmergencyStopped, Held, LineLost, NoAnswer, NotHomed, WasReset
from drivers.interfaces import CameraSettings, Caveat, ExposedFile, Imu, ProbeReading, ShakePath, Travel
from procedures.plan import HAS_IMU, HAS_SHAKER, Fact, Shake
from station.results.record_head import ENVIRONMENT

if TYPE_CHECKING:
    from station.bench.motions import StopRequest
    from station.bench.opening import Bench

POSITION_LOST = (Alarm, WasReset, NotHomed, EmergencyStopped)
LINE_TROUBLE = (NoAnswer, LineLost, Alarm, WasReset)
NOT_THERE = ("not connected", "the folder is gone")
SETTABLE = ("gphoto", "micromanager_camera", "genicam", "v4l2", "rpicam", "alpaca_camera")
"""Drivers whose camera is set through its cable; others are set by hand."""
AT = "at_"
"""Prefix of an axis' name: the fact with its position."""
LIGHT_LEVEL = "light_level"
DISTANCE = "distance_mm"


@dataclass(frozen=True)
class Snapshot:
    """State of the devices when a frame was taken; values that a device did not report are absent.

    axes : position by name, in the unit of the name
    distance_mm : from the rangefinder's housing
    silent : devices that did not answer, with the reason
    environment : readings by probe and quantity
    """

    axes: Mapping[str, float] = field(default_factory=dict)
    distance_mm: float | None = None
    light_level: float | None = None
    silent: Mapping[str, str] = field(default_factory=dict)
    environment: Mapping[str, Mapping[str, ProbeReading]] = field(default_factory=dict)

    def facts(self) -> dict[str, Fact]:
        """The state as facts."""
        facts: dict[str, Fact] = {AT + name: value for name, value in self.axes.items()}
        if self.distance_mm is not None:
            facts[DISTANCE] = self.distance_mm
        if self.light_level is not None:
            facts[LIGHT_LEVEL] = self.light_level
        return facts

    def record(self) -> dict[str, Any]:
        """The state as an entry of the session's journal."""
        record: dict[str, Any] = {"axes": dict(self.axes)}
        record |= {name: value for name, value in self.facts().items() if not name.startswith(AT)}
        if self.environment:
            record[ENVIRONMENT] = {
                probe: {name: asdict(reading) for name, reading in readings.items()}
                for probe, readings in self.environment.items()
            }
        return record | ({"silent": dict(self.silent)} if self.silent else {})


class ActiveDevices:
    """The devices of a bench that are in use, or none."""

    def __init__(self, bench: Bench | None) -> None:
        self.bench = bench
        self.excluded: set[str] = set()
        self.silent: dict[str, str] = {}
        """Devices that did not answer when last polled, with the reason; not polled again before `recover`."""
        self.places: dict[str, float] = {}
        """Last commanded position of each axis, once it has homed."""
        self.approve_homing: Callable[[Sequence[str]], None] = lambda names: None
        """Called before stages home to recover their position; an exception prevents the homing."""
        self._failed = ""
        self._stops = bench.stops if bench else 0

    def names(self) -> tuple[str, ...]:
        """Names of the devices in use."""
        return tuple(name for name in (self.bench.devices if self.bench else ()) if name not in self.excluded)

    def _device(self, name: str) -> Any:
        return self.bench.devices[name] if self.bench and name in self.names() else None

    @contextmanager
    def _using(self, name: str) -> Iterator[Any]:
        """A device; a failure is remembered for `recover`."""
        try:
            yield self._device(name)
        except DeviceError:
            self._failed = name
            raise

    def movers(self) -> tuple[str, ...]:
        """Names of the devices that move."""
        return tuple(name for name in self.names() if hasattr(self._device(name), "move_to"))

    def _home(self, name: str) -> None:
        assert self.bench is not None
        self.bench.motions.home(name, self._not_stopped)

    def _move(self, name: str, stage: Any, places: Mapping[str, float]) -> None:
        """Move a stage to those of the positions that are on its axes."""
        assert self.bench is not None
        targets = {axis: places[axis] for axis in stage.travel() if axis in places}
        if targets:
            self.bench.motions.move(name, targets)
            self.places |= targets

    @property
    def imu(self) -> Imu | None:
        """The IMU on the camera, or None."""
        return cast("Imu | None", self._device("imu"))

    @property
    def has_camera(self) -> bool:
        """Whether the bench has a camera."""
        return self._device("camera") is not None

    def abilities(self) -> dict[str, Fact]:
        """Equipment of the bench on which questions depend, as facts."""
        return {fact: True for name, fact in (("shaker", HAS_SHAKER), ("imu", HAS_IMU)) if name in self.names()}

    def start_shaking(self, shake: Shake) -> ShakePath | None:
        """Start the shaker on this path. Gives the commanded path, None without a shaker. Raises DeviceError."""
        with self._using("shaker") as shaker:
            if shaker is None:
                return None
            strokes = shaker.strokes()
            shares = {axis: values for axis, values in shake.shares.items() if axis in strokes}
            number = max(map(len, shares.values()), default=0)
            offsets = {axis: tuple(strokes[axis] * value for value in values) for axis, values in shares.items()}
            path: ShakePath = shaker.start(ShakePath(shake.round_s / max(number, 1), offsets))
            return path

    def shaking_since_s(self) -> float:
        """Time of the path's first point, by the clock of the last shot. Raises DeviceError."""
        with self._using("shaker") as shaker:
            return float(shaker.began_s())

    def stop_shaking(self) -> None:
        """Stop the shaker. Raises DeviceError."""
        with self._using("shaker") as shaker:
            shaker.stop()

    def unconnected(self) -> list[str]:
        """Devices that are not connected; a stage that has not homed is not among them."""
        conditions = {name: self._device(name).condition() for name in self.names()}
        return [name for name, condition in conditions.items() if not condition.usable and condition.word in NOT_THERE]

    def connect(self, name: str) -> None:
        """Connect one device. Raises DeviceError."""
        assert self.bench is not None
        self.bench.identities[name] = self._device(name).connect()

    def _lost(self) -> list[str]:
        return [name for name in self.movers() if not self._device(name).condition().usable]

    def exclude_lost(self) -> None:
        """Exclude the stages with an unknown position."""
        self.excluded.update(self._lost())

    def recover(self, error: Exception) -> None:
        """Prepare another attempt: reconnect silent devices, home stages that lost their position, and move back."""
        self.silent.clear()
        if isinstance(error, Held):
            self._device(self._failed).resume()
        again = set(self.unconnected())
        if isinstance(error, LINE_TROUBLE):
            again |= {"camera", "shutter"} if self._failed == "camera" else {self._failed}
        for name in self.names():
            if name in again:
                self._device(name).close()
                self.connect(name)
        lost = self._lost() or ([self._failed] if isinstance(error, POSITION_LOST) else [])
        names = [name for name in self.movers() if name in lost]
        if names:
            self.approve_homing(names)
        for name in names:
            with self._using(name) as stage:
                self._home(name)
                self._move(name, stage, self.places)

    def caveats(self) -> dict[str, Caveat]:
        """Caveats about the stages' reported positions, by device."""
        caveats = {name: self._device(name).condition().caveat for name in self.movers()}
        return {name: caveat for name, caveat in caveats.items() if caveat is not None}

    def home(self) -> None:
        """Home every stage. Raises DeviceError."""
        for name in self.movers():
            with self._using(name):
                self._home(name)
        self.silent.clear()
        self.places = self.positions()

    def _travels(self) -> dict[str, tuple[str, Travel]]:
        return {axis: (name, travel) for name in self.movers() for axis, travel in self._device(name).travel().items()}

    def travels(self, names: Sequence[str]) -> dict[str, Travel]:
        """Travel of the axes of these stages."""
        return {axis: travel for axis, (name, travel) in self._travels().items() if name in names}

    def moves(self, places: Mapping[str, float], least: float) -> bool:
        """Whether going to these places moves an axis by more than `least`."""
        axes = [axis for axis in places if axis in self.axes()]
        return any(axis not in self.places or abs(places[axis] - self.places[axis]) > least for axis in axes)

    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(self._travels())

    def obstacle(self, places: Mapping[str, float]) -> str | None:
        """Why the bench cannot go there: "" without the axes, a sentence outside their travel; None where it can."""
        travels = self._travels()
        if not places or not places.keys() <= travels.keys():
            return ""
        for axis, place in places.items():
            travel = travels[axis][1]
            if not travel.holds(place):
                return f"{axis} must be {place:.0f}; its travel is {travel.low:g} to {travel.high:g}"
        return None

    def target(self, moves: Mapping[str, float]) -> dict[str, float]:
        """Positions after these relative moves; an axis that the bench lacks starts at 0. Raises DeviceError."""
        here = self.positions() if any(axis in self.axes() for axis in moves) else {}
        return {axis: here.get(axis, 0.0) + change for axis, change in moves.items()}

    def positions(self) -> dict[str, float]:
        """Positions of the axes. Raises DeviceError, also for a stage that has lost its reference."""
        positions: dict[str, float] = {}
        for name in self.movers():
            with self._using(name) as stage:
                positions |= _homed_position(stage)
        return positions

    def axis_facts(self) -> dict[str, float]:
        """Position and travel limits of each axis, as facts. Raises DeviceError."""
        facts = {AT + name: value for name, value in self.positions().items()}
        for axis, (_, travel) in self._travels().items():
            facts |= {f"low_{axis}": travel.low, f"high_{axis}": travel.high}
        return facts

    def go_to(self, places: Mapping[str, float]) -> None:
        """Move to places; axes that the bench lacks are ignored. Raises DeviceError."""
        for name in self.movers():
            with self._using(name) as stage:
                self._move(name, stage, places)

    @property
    def has_light(self) -> bool:
        """Whether the bench has a lamp."""
        return self._device("light") is not None

    def set_light(self, level: float) -> bool:
        """Set the lamp. Gives whether there is one. Raises DeviceError."""
        with self._using("light") as light:
            if light is not None:
                light.set_level(level)
            return light is not None

    def flicker(self, exposure_s: float) -> Caveat | None:
        """The caveat about exposures that are too short for the lamp's modulation."""
        lamp = self._device("light")
        return None if lamp is None else lamp.flicker(exposure_s)

    def measure_mm(self) -> float | None:
        """The rangefinder's reading, None without a rangefinder. Raises DeviceError."""
        with self._using("rangefinder") as laser:
            return None if laser is None else float(laser.measure().distance_mm)

    @property
    def sets_exposure(self) -> bool:
        """Whether the camera's exposure time can be set through its cable."""
        return self.has_camera and self.bench is not None and self.bench.drivers.get("camera") in SETTABLE

    def set_exposure(self, exposure_s: float) -> None:
        """Set the exposure time. Raises DeviceError."""
        with self._using("camera") as camera:
            camera.configure(CameraSettings(exposure_s=exposure_s))

    def expose(self) -> ExposedFile:
        """One photograph by the bench's camera. Raises DeviceError."""
        with self._using("camera") as camera:
            exposure: ExposedFile = camera.expose()
            return exposure

    def snapshot(self) -> Snapshot:
        """State of every device; one that fails is recorded as silent and skipped until `recover`."""
        axes: dict[str, float] = {}
        environment: dict[str, Mapping[str, ProbeReading]] = {}
        distance_mm = None
        for name in self.names():
            device = self._device(name)
            if name in self.silent:
                continue
            try:
                if hasattr(device, "move_to"):
                    axes |= _homed_position(device)
                elif name == "rangefinder":
                    distance_mm = self.measure_mm()
                elif hasattr(device, "read"):
                    environment[name] = device.read()
            except DeviceError as error:
                if self.places or not isinstance(error, NotHomed):  # a plan without movements does not home
                    self.silent[name] = error.reason
        lamp = self._device("light")
        level = lamp.level() if lamp is not None else None
        return Snapshot(axes, distance_mm, level, dict(self.silent), environment)

    def announce(self, number: int) -> None:
        """Number the next frame as the session's shot."""
        if self.bench is not None:
            self.bench.surroundings.number_next_frame(number)

    def emergency_stop(self) -> None:
        """Stop everything now; pending homing is cancelled."""
        if self.bench is not None:
            self.bench.emergency_stop()

    def extinguish(self) -> None:
        """Switch the lamp off, if one is lit. Raises DeviceError."""
        lamp = self._device("light")
        if lamp is not None and lamp.level():
            with suppress(EmergencyStopped):  # a further stop ended the wait for the reply: once more
                lamp.set_level(0.0)
                return
            lamp.set_level(0.0)

    def _not_stopped(self) -> None:
        """Raises EmergencyStopped after an emergency stop since this object was made."""
        if self.bench is not None:
            self.bench.check_stops(self._stops)

    def stops(self) -> list[StopRequest]:
        """The emergency stops since this object was made."""
        return self.bench.stops_since(self._stops) if self.bench is not None else []


def _homed_position(stage: Any) -> dict[str, float]:
    """Position of a homed stage; a stage that was reset reports numbers without a reference. Raises DeviceError."""
    _check_homed(stage)
    position = dict(stage.position())
    _check_homed(stage)  # it may have been reset while it was asked
    return position


def _check_homed(stage: Any) -> None:
    condition = stage.condition()
    if not condition.usable:
        raise NotHomed(condition.word, condition.remedy)
