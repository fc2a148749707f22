"""station.toml becomes open devices. The one door to the simulators: a simulated bench is configured like a real one.

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
from typing import Any, cast

from drivers.clock import Clock, SystemClock
from drivers.errors import BadConfiguration, DeviceError, EmergencyStopped, NotConnected
from drivers.frames import Facts
from drivers.interfaces import (
    Camera,
    Condition,
    Device,
    Identity,
    Imu,
    Light,
    Rangefinder,
    Shaker,
    Shutter,
    Stage,
)
from drivers.micromanager.core import Core
from drivers.wire.transcript import Transcript
from procedures.outcome import BadInput
from procedures.reading.text import parse_toml, read_text
from station.bench.device_check import TableCheck
from station.bench.device_makers import MAKERS, Parts, maker_of
from station.bench.device_options import REFERS, named
from station.bench.motions import Motions
from station.bench.stopping import Asked, StopRequest, stop_all, stops_on_wires
from station.bench.surroundings import SimulatedSurroundings, Surroundings
from station.common.toml_lines import key_lines


@dataclass(frozen=True)
class DeviceRow:
    """One device as `station devices` shows it: what answered and how it is, or what is wrong."""

    name: str
    driver: str
    address: str
    identity: Identity | None
    condition: Condition
    error: DeviceError | None = None


@dataclass
class Bench:
    """The devices by name, in the order in which they are connected, and the clock they live by."""

    devices: dict[str, Device]
    drivers: Mapping[str, str]
    clock: Clock
    identities: dict[str, Identity] = field(default_factory=dict)
    transcripts: Mapping[str, Transcript] = field(default_factory=dict)
    _on_close: Sequence[Callable[[], None]] = ()
    surroundings: Surroundings = field(default_factory=Surroundings)
    simulated: Any = None
    _stops: list[Asked] = field(default_factory=list)
    motions: Motions = field(init=False)

    def __post_init__(self) -> None:
        self.motions = Motions(self.devices, self.clock)

    def connect(self) -> None:
        """Connect all devices; those that answer stay connected. Raises NotConnected naming all the others."""
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

    def _find(self, name: str) -> Device:
        if name not in self.devices:
            raise BadConfiguration(f"no device is called {name}", f"add [devices.{name}] to station.toml")
        return self.devices[name]

    @property
    def stage(self) -> Stage:
        """The rail or gantry. Raises BadConfiguration if there is none; so do the others."""
        return cast(Stage, self._find("stage"))

    @property
    def head(self) -> Stage:
        """The pan-tilt head."""
        return cast(Stage, self._find("head"))

    @property
    def camera(self) -> Camera:
        """The camera."""
        return cast(Camera, self._find("camera"))

    @property
    def shutter(self) -> Shutter:
        """The shutter box."""
        return cast(Shutter, self._find("shutter"))

    @property
    def shaker(self) -> Shaker:
        """What shakes the camera."""
        return cast(Shaker, self._find("shaker"))

    @property
    def imu(self) -> Imu:
        """The IMU on the camera."""
        return cast(Imu, self._find("imu"))

    @property
    def rangefinder(self) -> Rangefinder:
        """The laser."""
        return cast(Rangefinder, self._find("rangefinder"))

    @property
    def light(self) -> Light:
        """The lamp."""
        return cast(Light, self._find("light"))

    def log_wires(self, folder: Path | None) -> None:
        """From now on, write what passes on each wire into a file of its own in this folder; into none where None."""
        for name, transcript in self.transcripts.items():
            transcript.write_to(folder / f"wire-{name}.txt" if folder else None)

    def emergency_stop(self) -> None:
        """Stop everything, side by side, stages first; from any thread, any number of times."""
        asked = Asked(self.clock.now_s())
        self._stops.append(asked)
        stop_all(sorted(self.devices.values(), key=lambda device: not hasattr(device, "move_to")))
        asked.done.set()

    @property
    def stops(self) -> int:
        """How many emergency stops there were."""
        return len(self._stops)

    def stops_since(self, number: int) -> list[StopRequest]:
        """The emergency stops after the first `number`, and when each was on which wire."""
        return stops_on_wires(self._stops[number:], self.transcripts)

    def check_stops(self, number: int) -> None:
        """Raises EmergencyStopped where there were more emergency stops than `number`."""
        if self.stops != number:
            raise EmergencyStopped("everything was stopped", "make it safe, then home")

    def close(self) -> None:
        """Give all lines back, in the reverse order."""
        for device in reversed(self.devices.values()):
            device.close()
        for end in self._on_close:
            end()


def read_config(path: Path) -> dict[str, Any]:
    """The devices' tables of a station.toml, every value checked; none where it tells a unit alone.

    Raises
    ------
    BadConfiguration
        With the line.
    """
    if not path.exists():
        raise BadConfiguration(f"there is no {path}", "write one, or use --simulate")
    try:
        text = read_text(path, "TOML file", "correct it")
        config = parse_toml(text, str(path), "correct that line")
    except BadInput as error:
        raise BadConfiguration(error.reason, error.remedy) from error
    devices = config.get("devices")
    if config.keys() == {"unit"}:
        return {}
    if not isinstance(devices, dict) or not devices:
        raise BadConfiguration(f"{path} configures no devices", "add tables like [devices.stage]")
    TableCheck(devices, path.name, key_lines(text)).check()
    return devices


def make_bench(
    tables: Mapping[str, Mapping[str, Any]], *, folder: Path, clock: Clock | None = None, wire_log: Path | None = None
) -> Bench:
    """The configured devices, not yet connected; relative folders begin at `folder`. Raises BadConfiguration."""
    TableCheck(tables).check()
    clock = clock or SystemClock()
    made: dict[str, Device] = {}
    transcripts: dict[str, Transcript] = {}
    cores: dict[Path, Core] = {}
    for name in sorted(tables, key=lambda one: _depth(tables, one)):
        options = {key: value for key, value in tables[name].items() if key != "driver"}
        parts = Parts(made, folder, clock, inspect_raw, wire_log, transcripts, cores)
        made[name] = maker_of(tables[name]["driver"])(name, parts, **options)
    return Bench(made, {name: str(tables[name]["driver"]) for name in made}, clock, transcripts=transcripts)


def _depth(tables: Mapping[str, Mapping[str, Any]], name: str) -> int:
    """How many devices must be there before this one, one after another."""
    others = [other for key in REFERS for other in named(tables[name], key)]
    return max((1 + _depth(tables, other) for other in others), default=0)


def inspect_raw(path: Path) -> Facts:
    """What a RAW file says about its exposure, once it has been read as a whole. Raises BadInput if it cannot be."""
    from procedures.raw import read_frame

    told = read_frame(path).exposure
    return Facts(told.exposure_s, None if told.iso is None else round(told.iso), told.f_number)


def simulated_bench(
    folder: Path, *, seed: int = 0, faults: bool = False, virtual_time: bool = False, shaker: bool = False
) -> Bench:
    """A bench whose devices are simulated in this process; `bench.simulated` is the truth behind it.

    Without `shaker` the rig is set in motion by hand.
    """
    from simulators.bench.bench import Setup, SimulatedBench, random_trouble

    spoilt, mishaps = random_trouble(seed) if faults else ({}, ())
    truth = SimulatedBench(folder, Setup(seed=seed, faults=spoilt, mishaps=mishaps, virtual_time=virtual_time))
    bench = make_bench(simulated_tables(truth.address, folder, shaker=shaker), folder=folder, clock=truth.clock)
    bench.surroundings = SimulatedSurroundings(truth)
    bench.simulated, bench._on_close = truth, (truth.close,)
    return bench


SHAKER: dict[str, Any] = {
    "driver": "strig_shaker",
    "box": "shutter",
    "axes": [{"name": "x_mm", "channel": 0, "stroke": 2.0}, {"name": "y_mm", "channel": 1, "stroke": 2.0}],
}
"""The table of the simulated bench's shaker."""


def fit_shaker(bench: Bench, *, wanted: bool) -> None:
    """Give a simulated bench its shaker, or take it off. Threads may be going through the devices: they are new."""
    devices, drivers = dict(bench.devices), dict(bench.drivers)
    if wanted and "shaker" not in devices:
        options = {key: value for key, value in SHAKER.items() if key != "driver"}
        parts = Parts(devices, Path(), bench.clock, inspect_raw)
        devices["shaker"] = MAKERS[SHAKER["driver"]]("shaker", parts, **options)
        drivers["shaker"] = SHAKER["driver"]
    elif not wanted and "shaker" in devices:
        del devices["shaker"], drivers["shaker"]
        bench.identities.pop("shaker", None)
    else:
        return
    bench.devices, bench.drivers = devices, drivers
    bench.rows()


def simulated_tables(address: Callable[[str], str], folder: Path, *, shaker: bool = False) -> dict[str, dict[str, Any]]:
    """The configuration of the simulated bench, as it would stand in station.toml."""
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
        **({"shaker": SHAKER} if shaker else {}),
    }
