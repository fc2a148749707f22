"""The bench as a run uses it: axes by name whichever stage has them, what every device says of itself, and mending."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

from drivers.errors import Alarm, DeviceError, EmergencyStopped, Held, LineLost, NoAnswer, NotHomed, WasReset
from drivers.interfaces import CameraSettings, Doubt, ExposedFile, Imu, ShakePath, Travel
from procedures.plan import HAS_IMU, HAS_SHAKER, Fact, Shake

if TYPE_CHECKING:
    from station.bench.motions import Motions
    from station.bench.opening import Bench
    from station.bench.stopping import StopRequest

POSITION_LOST = (Alarm, WasReset, NotHomed, EmergencyStopped)
LINE_TROUBLE = (NoAnswer, LineLost, Alarm, WasReset)
NOT_THERE = ("not connected", "the folder is gone")
SETTABLE = ("gphoto", "micromanager_camera", "genicam", "alpaca_camera")
"""Drivers whose camera takes its settings from here; others are set by hand."""
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
        self.silent: dict[str, str] = {}
        """What did not answer when it was last asked how it is, and why; not asked again before something is mended."""
        self.places: dict[str, float] = {}
        """Where each axis was sent last, once it has homed."""
        self.agree: Callable[[Sequence[str]], None] = lambda names: None
        """Called before stages home to be mended; what it raises prevents that."""
        self._failed = ""
        self._stops = bench.stops if bench else 0

    def names(self) -> tuple[str, ...]:
        """Of the devices in use."""
        return tuple(name for name in (self.bench.devices if self.bench else ()) if name not in self.left_out)

    def _device(self, name: str) -> Any:
        return self.bench.devices[name] if self.bench and name in self.names() else None

    @contextmanager
    def _using(self, name: str) -> Iterator[Any]:
        """A device; that it failed is remembered for mending."""
        try:
            yield self._device(name)
        except DeviceError:
            self._failed = name
            raise

    def movers(self) -> tuple[str, ...]:
        """Names of all that moves."""
        return tuple(name for name in self.names() if hasattr(self._device(name), "move_to"))

    @property
    def _motions(self) -> Motions:
        assert self.bench is not None
        return self.bench.motions

    @property
    def imu(self) -> Imu | None:
        """The IMU on the camera, if there is one."""
        return cast("Imu | None", self._device("imu"))

    @property
    def has_camera(self) -> bool:
        """Whether the bench photographs by itself."""
        return self._device("camera") is not None

    # --- shaking

    def abilities(self) -> dict[str, Fact]:
        """What the bench has that questions depend on, as facts."""
        return {fact: True for name, fact in (("shaker", HAS_SHAKER), ("imu", HAS_IMU)) if name in self.names()}

    def start_shaking(self, shake: Shake) -> ShakePath | None:
        """Let the shaker go around this path; as it is commanded, None where there is none. Raises DeviceError."""
        with self._using("shaker") as shaker:
            if shaker is None:
                return None
            strokes = shaker.strokes()
            shares = {axis: shares for axis, shares in shake.shares.items() if axis in strokes}
            number = max(map(len, shares.values()), default=0)
            offsets = {axis: tuple(strokes[axis] * one for one in each) for axis, each in shares.items()}
            path: ShakePath = shaker.start(ShakePath(shake.round_s / max(number, 1), offsets))
            return path

    def shaking_since_s(self) -> float:
        """When the first point of the path was put out, by the clock of the last shot. Raises DeviceError."""
        with self._using("shaker") as shaker:
            return float(shaker.began_s())

    def stop_shaking(self) -> None:
        """Come to rest. Raises DeviceError."""
        with self._using("shaker") as shaker:
            shaker.stop()

    # --- connecting and mending

    def unconnected(self) -> list[str]:
        """Devices whose line is not open; a stage that has not homed yet is none of them."""
        conditions = {name: self._device(name).condition() for name in self.names()}
        return [name for name, told in conditions.items() if not told.usable and told.word in NOT_THERE]

    def connect(self, name: str) -> None:
        """Connect one device. Raises DeviceError."""
        assert self.bench is not None
        self.bench.identities[name] = self._device(name).connect()

    def _lost(self) -> list[str]:
        """Stages that do not know where they are."""
        return [name for name in self.movers() if not self._device(name).condition().usable]

    def leave_out_lost(self) -> None:
        """Do without the stages that do not know where they are."""
        self.left_out.update(self._lost())

    def mend(self, error: Exception) -> None:
        """What can be done before trying again: connect what fell silent, home what lost its position, and go back."""
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
            self.agree(names)
        for name in names:
            with self._using(name) as stage:
                self._motions.home(name, self._not_stopped)
                own = {axis: self.places[axis] for axis in stage.travel() if axis in self.places}
                if own:
                    self._motions.move(name, own)

    def doubts(self) -> dict[str, Doubt]:
        """Why stages deserve less trust than they claim, by device."""
        told = {name: self._device(name).condition().doubt for name in self.movers()}
        return {name: doubt for name, doubt in told.items() if doubt is not None}

    # --- moving

    def home(self) -> None:
        """Every stage finds its reference. Raises DeviceError."""
        for name in self.movers():
            with self._using(name):
                self._motions.home(name, self._not_stopped)
        self.silent.clear()
        self.places = self.positions()

    def _travels(self) -> dict[str, tuple[str, Travel]]:
        """By axis: whose it is, and how far it goes."""
        return {axis: (name, travel) for name in self.movers() for axis, travel in self._device(name).travel().items()}

    def travels(self, names: Sequence[str]) -> dict[str, Travel]:
        """How far the axes of these stages go."""
        return {axis: travel for axis, (name, travel) in self._travels().items() if name in names}

    def moves(self, places: Mapping[str, float], least: float) -> bool:
        """Whether going to these places moves anything by more than this."""
        axes = [axis for axis in places if axis in self.axes()]
        return any(axis not in self.places or abs(places[axis] - self.places[axis]) > least for axis in axes)

    def axes(self) -> tuple[str, ...]:
        """Names of what can be moved."""
        return tuple(self._travels())

    def obstacle(self, places: Mapping[str, float]) -> str | None:
        """Why the bench cannot go there by itself: "" where it has not the axes, else what is in the way."""
        travels = self._travels()
        if not places or not all(axis in travels for axis in places):
            return ""
        for axis, place in places.items():
            travel = travels[axis][1]
            if not travel.holds(place):
                return f"{axis} goes from {travel.low:g} to {travel.high:g}, and {place:.0f} would be needed"
        return None

    def target(self, moves: Mapping[str, float]) -> dict[str, float]:
        """Where these moves from here lead; axes that the bench has not are where they are at 0. Raises DeviceError."""
        here = self.positions() if any(axis in self.axes() for axis in moves) else {}
        return {axis: here.get(axis, 0.0) + change for axis, change in moves.items()}

    def positions(self) -> dict[str, float]:
        """Where the axes are now. Raises DeviceError, also where a stage only believes to know."""
        found: dict[str, float] = {}
        for name in self.movers():
            with self._using(name) as stage:
                found |= _sure_position(stage)
        return found

    def axis_facts(self) -> dict[str, float]:
        """Where each axis is, and the ends of its travel, as facts. Raises DeviceError."""
        facts = {AT + name: value for name, value in self.positions().items()}
        for axis, (_, travel) in self._travels().items():
            facts |= {f"low_{axis}": travel.low, f"high_{axis}": travel.high}
        return facts

    def go_to(self, places: Mapping[str, float]) -> None:
        """Move to places; axes that the bench has not are left out. Raises DeviceError."""
        for name in self.movers():
            with self._using(name) as stage:
                own = {axis: places[axis] for axis in stage.travel() if axis in places}
                if own:
                    self._motions.move(name, own)
                    self.places |= own

    # --- light, laser, camera

    def set_light(self, level: float) -> bool:
        """Set the lamp; whether there is one. Raises DeviceError."""
        with self._using("light") as light:
            if light is not None:
                light.set_level(level)
            return light is not None

    def measure_mm(self) -> float | None:
        """The rangefinder's reading, None where there is none. Raises DeviceError."""
        with self._using("rangefinder") as laser:
            return None if laser is None else float(laser.measure().distance_mm)

    @property
    def sets_exposure(self) -> bool:
        """Whether the camera's exposure time is set through its cable."""
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

    # --- what is so now

    def snapshot(self) -> Snapshot:
        """What every device says now; one that fails is named, and left out until something is mended."""
        axes: dict[str, float] = {}
        distance_mm = None
        for name in self.names():
            device = self._device(name)
            if name in self.silent:
                continue
            try:
                if hasattr(device, "move_to"):
                    axes |= _sure_position(device)
                elif name == "rangefinder":
                    distance_mm = self.measure_mm()
            except DeviceError as error:
                if self.places or not isinstance(error, NotHomed):  # a plan that moves nothing homes nothing
                    self.silent[name] = error.reason
        lamp = self._device("light")
        level = lamp.level() if lamp is not None else None
        return Snapshot(axes, distance_mm, level, dict(self.silent))

    def announce(self, number: int) -> None:
        """The next frame is the session's shot of this number."""
        if self.bench is not None:
            self.bench.surroundings.number_next_frame(number)

    def emergency_stop(self) -> None:
        """Everything stops, now; nothing homes any more."""
        if self.bench is not None:
            self.bench.emergency_stop()

    def _not_stopped(self) -> None:
        """Raises EmergencyStopped where there was an emergency stop since this rig was made."""
        if self.bench is not None:
            self.bench.check_stops(self._stops)

    def stops(self) -> list[StopRequest]:
        """The emergency stops since this rig was made."""
        return self.bench.stops_since(self._stops) if self.bench is not None else []


def _sure_position(stage: Any) -> dict[str, float]:
    """Where a stage is; one that was reset still tells numbers, but not where it is. Raises DeviceError."""
    told = stage.condition()
    if not told.usable:
        raise NotHomed(told.word, told.remedy)
    return dict(stage.position())
