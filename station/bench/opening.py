"""Opens the devices of station.toml; alone imports the simulators, whose bench is configured like a real one.

```toml
[devices.stage]
driver = "grbl"
port = "usb:A10K8QZV"           # or /dev/ttyUSB0, COM3, socket://host:port, rfc2217://host:port
axes = [{ name = "z_mm", letter = "X", feed_per_min = 3000 }]

[devices.shutter]
driver = "strig"                # or "rts", or "relay" with on = "stage"
port = "/dev/ttyACM0"

[devices.camera]
driver = "folder"               # or "gphoto", extra `tether`
folder = "incoming"
shutter = "shutter"
```
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, cast

from drivers.errors import BadConfiguration, Clock, DeviceError, EmergencyStopped, NotConnected, SystemClock
from drivers.frames import ExposureMetadata
from drivers.interfaces import Camera, Condition, Device, FrameFormat, Identity, Imu, Light, Shaker, Shutter, Stage
from drivers.making import DriverOptions, MakerContext
from drivers.wire.connection import Transcript
from procedures.outcome import BadInput
from procedures.raw import Plane
from procedures.reading.text import parse_toml, read_text
from station.bench.device_models import named, options_of, read_devices
from station.bench.motions import Motions, StopRecord, StopRequest, stop_all, stops_on_wires
from station.common.errors import log
from station.common.models import TableSource, read_model

if TYPE_CHECKING:
    from procedures.plan import Fact, Facts
    from simulators.bench.bench import SimulatedBench


class OperatorActions(Protocol):
    """Interface to an operator's actions and observations."""

    @property
    def in_real_time(self) -> bool:
        """Whether the bench's time passes as for a person, so that its moves can be watched."""

    def knows(self, key: str) -> Fact | None:
        """The operator's answer; None if the question's default applies."""

    def do(self, key: str, facts: Facts) -> None:
        """The action of the operator who confirms this question."""

    def take_up(self, facts: Facts) -> None:
        """Restore the state left by an earlier run with these facts."""

    def follow(self, by_hand: Mapping[str, float]) -> None:
        """Adjust what was requested in numbers: chart angle, focus ring, exposure dial."""


class Surroundings:
    """A real room, in which the operator acts."""

    @property
    def hands(self) -> OperatorActions | None:
        """None: the operator acts."""
        return None

    def stand_before(self, subject: str) -> None:
        """Place "chart", "wall", "depth", "panel" or "edge" before the camera."""

    def number_next_frame(self, number: int) -> None:
        """Announce the session's shot number of the next frame."""


class SimulatedSurroundings(Surroundings):
    """The room of a simulated bench: its subjects, its operator, and frames with noise seeded by their number."""

    def __init__(self, truth: SimulatedBench) -> None:
        self._truth = truth

    @property
    def hands(self) -> OperatorActions:
        return self._truth.hands

    def stand_before(self, subject: str) -> None:
        self._truth.show(subject)

    def number_next_frame(self, number: int) -> None:
        self._truth.body.next_number = number


@dataclass(frozen=True)
class DeviceRow:
    """One device as shown by `station devices`: its identity and condition, or its error."""

    name: str
    driver: str
    address: str
    identity: Identity | None
    condition: Condition
    error: DeviceError | None = None


D = TypeVar("D")
STILL_LIT, SWITCH_OFF = "the lamp may still be lit: {}", "switch it off by hand"


class NamedDevice(Generic[D]):
    """The device of this name in a bench. Raises BadConfiguration if there is none."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, bench: Bench, _: object = None) -> D:
        if self._name not in bench.devices:
            name = self._name
            raise BadConfiguration(f"no device has the name {name}", f"add [devices.{name}] to station.toml")
        return cast(D, bench.devices[self._name])


@dataclass
class Bench:
    """The devices by name, in the order of their connection, and their clock."""

    devices: dict[str, Device]
    drivers: Mapping[str, str]
    clock: Clock
    identities: dict[str, Identity] = field(default_factory=dict)
    transcripts: Mapping[str, Transcript] = field(default_factory=dict)
    _on_close: Sequence[Callable[[], None]] = ()
    surroundings: Surroundings = field(default_factory=Surroundings)
    simulated: Any = None
    _stops: list[StopRecord] = field(default_factory=list)
    motions: Motions = field(init=False)

    def __post_init__(self) -> None:
        self.motions = Motions(self.devices, self.clock)

    def connect(self) -> None:
        """Connect all devices; those that answer stay connected. Raises NotConnected naming all others."""
        failures = {row.name: row.error for row in self.rows() if row.error is not None}
        if failures:
            raise NotConnected(failures)

    def rows(self) -> list[DeviceRow]:
        """Each device after an attempt to connect it."""
        return [self._row(name) for name in self.devices]

    def _row(self, name: str) -> DeviceRow:
        device, driver = self.devices[name], self.drivers[name]
        try:
            self.identities[name] = identity = device.connect()
        except DeviceError as error:
            return DeviceRow(name, driver, device.address, None, device.condition(), error)
        return DeviceRow(name, driver, device.address, identity, device.condition())

    stage = NamedDevice[Stage]("stage")
    head = NamedDevice[Stage]("head")
    camera = NamedDevice[Camera]("camera")
    shutter = NamedDevice[Shutter]("shutter")
    shaker = NamedDevice[Shaker]("shaker")
    imu = NamedDevice[Imu]("imu")
    light = NamedDevice[Light]("light")

    def log_wires(self, folder: Path | None) -> None:
        """From now on, write each line's transcript to a file in this folder; to none if None."""
        for name, transcript in self.transcripts.items():
            transcript.write_to(folder / f"wire-{name}.txt" if folder else None)

    def emergency_stop(self) -> None:
        """Stop everything simultaneously, stages first; thread-safe, any number of times."""
        request = StopRecord(self.clock.now_s())
        self._stops.append(request)
        stop_all(sorted(self.devices.values(), key=lambda device: not hasattr(device, "move_to")))
        request.done.set()

    @property
    def stops(self) -> int:
        """Number of emergency stops so far."""
        return len(self._stops)

    def stops_since(self, number: int) -> list[StopRequest]:
        """The emergency stops after the first `number`, with the times of their bytes on each line."""
        return stops_on_wires(self._stops[number:], self.transcripts)

    def check_stops(self, number: int) -> None:
        """Raises EmergencyStopped if there were more than `number` emergency stops."""
        if self.stops != number:
            raise EmergencyStopped("everything was stopped", "make it safe, then home")

    def close(self) -> None:
        """Switch the lamp off if it is lit, and release all lines, in the reverse order."""
        lamp = self.devices.get("light")
        try:
            if lamp is not None and "light" in self.identities and cast(Light, lamp).level():
                cast(Light, lamp).set_level(0.0)
        except DeviceError as error:
            log("lamp", STILL_LIT.format(error.reason), level="warning", remedy=SWITCH_OFF)
        for device in reversed(self.devices.values()):
            device.close()
        for end in self._on_close:
            end()


KEYS = {"devices", "unit"}
"""Tables and values that a station.toml may have."""


def read_config(path: Path) -> dict[str, Any]:
    """The devices' tables of a station.toml, every value checked; empty if it sets only a unit. Raises BadConfiguration
    that names the line of the error."""
    if not path.exists():
        raise BadConfiguration(f"there is no {path}", "write one, or use --simulate")
    try:
        text = read_text(path, "TOML file", "correct it")
        config = parse_toml(text, str(path), "correct that line")
    except BadInput as error:
        raise BadConfiguration(error.reason, error.remedy) from error
    devices, source = config.get("devices"), TableSource(path.name, text, error=BadConfiguration)
    for key in config.keys() - KEYS:
        source.refuse_unknown((key,), sorted(KEYS))
    if config.keys() == {"unit"}:
        return {}
    if not isinstance(devices, dict) or not devices:
        raise BadConfiguration(f"{path} configures no devices", "add tables like [devices.stage]")
    read_devices(devices, source)
    return devices


def make_bench(
    tables: Mapping[str, Mapping[str, Any]], *, folder: Path, clock: Clock | None = None, wire_log: Path | None = None
) -> Bench:
    """The configured devices, not yet connected; relative folders refer to `folder`. Raises BadConfiguration."""
    devices = read_devices(tables)
    clock = clock or SystemClock()
    made: dict[str, Device] = {}
    transcripts: dict[str, Transcript] = {}
    shared: dict[object, Any] = {}
    for name in sorted(devices, key=lambda name: _depth(devices, name)):
        parts = MakerContext(name, made, folder, clock, inspect_raw, wire_log, transcripts, shared)
        made[name] = devices[name].make(parts)
    _check_uses(made, tables)
    return Bench(made, {name: str(tables[name]["driver"]) for name in made}, clock, transcripts=transcripts)


USES = {
    "stage": "move_to", "head": "move_to", "camera": "expose", "shutter": "fire", "shaker": "strokes",
    "imu": "read_block", "rangefinder": "measure", "light": "set_level",
}  # fmt: skip
"""Names by which procedures use devices, and a method that each requires."""


def _check_uses(made: Mapping[str, Device], tables: Mapping[str, Mapping[str, Any]]) -> None:
    """Raises BadConfiguration for a name with a driver of another kind, and for an axis that two stages have."""
    owners: dict[str, str] = {}
    for name, device in made.items():
        if not hasattr(device, USES.get(name, "close")):
            reason = f"devices.{name} must have a driver that serves as {name}; {tables[name]['driver']} does not"
            raise BadConfiguration(reason, "use another driver, or give the device another name")
        for axis in tables[name].get("axes", ()) if hasattr(device, "move_to") else ():
            if (owner := owners.setdefault(axis["name"], name)) != name:
                reason = f"the axes of all stages must have different names; {owner} and {name} have {axis['name']}"
                raise BadConfiguration(reason, "rename one")


def _depth(devices: Mapping[str, DriverOptions], name: str) -> int:
    """Number of devices that must be created before this one, in sequence."""
    return max((1 + _depth(devices, other) for _, other, _ in named(devices[name])), default=0)


def inspect_raw(path: Path) -> ExposureMetadata:
    """The exposure metadata of a RAW file that can be read completely. Raises BadInput otherwise."""
    from procedures.raw import read_frame

    frame = read_frame(path)
    exposure, planes = frame.exposure, list(frame.planes.values())
    return ExposureMetadata(
        exposure.exposure_s,
        None if exposure.iso is None else round(exposure.iso),
        exposure.f_number,
        frame_format(planes, exposure.pixel_pitch_um),
    )


def frame_format(planes: Sequence[Plane], pixel_pitch_um: float | None = None) -> FrameFormat:
    """The format of the sensor that gave these planes: one, or the four of a Bayer mosaic."""
    white, pitch = round(planes[0].white), planes[0].pitch
    rows, columns = (
        max(plane.origin[axis] + pitch * (plane.samples.shape[1 - axis] - 1) + 1 for plane in planes) for axis in (1, 0)
    )
    colours = {plane.origin: plane.name[0] for plane in planes}
    tile = "".join(colours.get((x, y), "") for y in (0, 1) for x in (0, 1))
    return FrameFormat(columns, rows, tile if len(planes) == 4 else None, white, pixel_pitch_um)


def simulated_bench(
    folder: Path, *, seed: int = 0, faults: bool = False, virtual_time: bool = False, shaker: bool = False,
    speed: float = 1.0,
) -> Bench:  # fmt: skip
    """A bench of simulated devices, `bench.simulated` the truth; without `shaker` the rig is moved by hand. Its time
    runs `speed` times as fast as real time."""
    from simulators.bench.bench import Setup, SimulatedBench, random_trouble

    cable_faults, events = random_trouble(seed) if faults else ({}, ())
    setup = Setup(
        seed=seed, faults=cable_faults, fault_events=events, virtual_time=virtual_time or speed != 1.0,
        speed=1.0 if virtual_time else speed,
    )  # fmt: skip
    truth = SimulatedBench(folder, setup)
    tables = simulated_tables(truth.address, folder, shaker=shaker)
    sensor = truth.view.camera.sensor
    tables["camera"]["sensor"] = f"{sensor.columns}x{sensor.rows} {sensor.cfa or 'grey'} {sensor.white.bit_length()}"
    bench = make_bench(tables, folder=folder, clock=truth.clock)
    bench.surroundings = SimulatedSurroundings(truth)
    bench.simulated, bench._on_close = truth, (truth.close,)
    return bench


SHAKER: dict[str, Any] = {
    "driver": "strig_shaker",
    "box": "shutter",
    "axes": [{"name": "x_mm", "channel": 0, "stroke": 2.0}, {"name": "y_mm", "channel": 1, "stroke": 2.0}],
}


def fit_shaker(bench: Bench, *, wanted: bool) -> None:
    """Add a simulated bench's shaker, or remove it. The mapping is replaced, as other threads may iterate over it."""
    devices, drivers = dict(bench.devices), dict(bench.drivers)
    if wanted and "shaker" not in devices:
        parts = MakerContext("shaker", devices, Path(), bench.clock, inspect_raw)
        options = {key: value for key, value in SHAKER.items() if key != "driver"}
        devices["shaker"] = read_model(options_of(SHAKER["driver"]), options, TableSource()).make(parts)
        drivers["shaker"] = SHAKER["driver"]
    elif not wanted and "shaker" in devices:
        del devices["shaker"], drivers["shaker"]
        bench.identities.pop("shaker", None)
    else:
        return
    bench.devices, bench.drivers = devices, drivers
    bench.rows()


ROOM = {
    "temperature": "MEAS:TEMP?", "temperature_uncertainty": 0.1,
    "humidity": "MEAS:HUM?", "humidity_uncertainty": 2.0,
}  # fmt: skip


def simulated_tables(address: Callable[[str], str], folder: Path, *, shaker: bool = False) -> dict[str, dict[str, Any]]:
    """The configuration of the simulated bench, as in a station.toml."""
    letters = (("z_mm", "X", 3000.0), ("x_mm", "Y", 1500.0), ("y_mm", "Z", 1500.0))
    pan_tilt = (("pan_deg", 1, -30.0), ("tilt_deg", 2, -20.0))
    step = 0.000234375
    return {
        "stage": {
            "driver": "grbl",
            "port": address("stage"),
            "axes": [{"name": name, "letter": letter, "feed_per_min": feed} for name, letter, feed in letters],
        },
        "head": {
            "driver": "zaber",
            "port": address("head"),
            "axes": [
                {"name": name, "device": number, "unit_per_step": step, "zero": low, "speed_per_s": 10.0}
                for name, number, low in pan_tilt
            ],
        },
        "shutter": {"driver": "strig", "port": address("shutter")},
        "camera": {"driver": "folder", "folder": str(folder), "shutter": "shutter"},
        "imu": {"driver": "wit", "port": address("imu")},
        "fast_imu": {"driver": "fast", "port": address("fast_imu")},
        "rangefinder": {"driver": "jrt", "port": address("rangefinder")},
        "light": {"driver": "dmx", "port": address("light")},
        "room": {"driver": "scpi_probe", "port": address("room"), **ROOM},
        **({"shaker": SHAKER} if shaker else {}),
    }
