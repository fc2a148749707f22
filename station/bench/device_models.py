"""Drivers by their name in station.toml, and the check of a station.toml before a device is made.

Built-in drivers and those of installed packages (entry-point group `station.drivers`) are named alike: by the model of
their options, imported when it is used.
"""

import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from drivers.errors import BadConfiguration
from drivers.making import DriverOptions
from station.common.models import TableSource, fields_of, read_model, require_table, shown
from station.common.toml_text import toml_value

GROUP = "station.drivers"
NAME = re.compile(r"[\w-]{1,64}")
BUILTIN: Mapping[str, str] = {
    "grbl": "drivers.grbl:GrblOptions",
    "zaber": "drivers.zaber:ZaberOptions",
    "tmcl_stage": "drivers.tmcl.stage:TmclOptions",
    "esp301": "drivers.newport:Esp301Options",
    "smc100": "drivers.newport:Smc100Options",
    "apt": "drivers.thorlabs:AptOptions",
    "gcs": "drivers.gcs:GcsOptions",
    "strig": "drivers.shutter:StrigOptions",
    "strig_shaker": "drivers.shaker:ShakerOptions",
    "strig_imu": "drivers.imu:StrigImuOptions",
    "strig_watchdog": "drivers.watchdog:WatchdogOptions",
    "rts": "drivers.shutter:RtsOptions",
    "relay": "drivers.shutter:RelayOptions",
    "folder": "drivers.folder_camera:FolderOptions",
    "gphoto": "drivers.gphoto:GphotoOptions",
    "micromanager_stage": "drivers.micromanager.stage:MicroManagerStageOptions",
    "micromanager_camera": "drivers.micromanager.camera:MicroManagerCameraOptions",
    "micromanager_shutter": "drivers.micromanager.camera:MicroManagerShutterOptions",
    "genicam": "drivers.genicam.camera:GenicamOptions",
    "v4l2": "drivers.v4l2.camera:V4l2Options",
    "rpicam": "drivers.rpicam:RpicamOptions",
    "alpaca_stage": "drivers.alpaca.stage:AlpacaStageOptions",
    "alpaca_camera": "drivers.alpaca.camera:AlpacaCameraOptions",
    "alpaca_light": "drivers.alpaca.switch:AlpacaLightOptions",
    "alpaca_shutter": "drivers.alpaca.switch:AlpacaShutterOptions",
    "alpaca_probe": "drivers.alpaca.link:AlpacaProbeOptions",
    "wit": "drivers.imu:WitOptions",
    "fast": "drivers.imu:FastOptions",
    "jrt": "drivers.rangefinder:JrtOptions",
    "bosch": "drivers.rangefinder:BoschOptions",
    "dmx": "drivers.light:DmxOptions",
    "artnet": "drivers.artnet:ArtNetOptions",
    "scpi_light": "drivers.scpi:ScpiLightOptions",
    "scpi_probe": "drivers.scpi:ScpiProbeOptions",
    "grbl_light": "drivers.light:GrblLightOptions",
}
"""Name -> module and model of options, as an entry point names them."""


@cache
def drivers() -> dict[str, EntryPoint]:
    """All drivers by name, the built-in ones first; they cannot be replaced."""
    builtin = {name: EntryPoint(name, model, GROUP) for name, model in BUILTIN.items()}
    return {**builtin, **{point.name: point for point in entry_points(group=GROUP) if point.name not in BUILTIN}}


def options_of(driver: str) -> type[DriverOptions]:
    """The options of a driver. Raises KeyError where there is none of that name."""
    model: type[DriverOptions] = drivers()[driver].load()
    return model


def read_devices(tables: Mapping[str, Any], source: TableSource | None = None) -> dict[str, DriverOptions]:
    """The options of the devices of a station.toml. Raises BadConfiguration about the first error."""
    source = source or TableSource(error=BadConfiguration)
    devices = {name: _read_device(name, table, source) for name, table in tables.items()}
    owners: dict[str, str] = {}
    for name, options in devices.items():
        port = getattr(options, "port", None)
        if port in owners:
            words = f"must differ; {shown(port)} is already given to {owners[port]}"
            remedy = "name another port; relays and lamps on a stage's controller use `on`"
            source.refuse(("devices", name, "port"), words, remedy)
        if port:
            owners[port] = name
    for name in devices:
        for key, other, kind in named(devices[name]):
            _check_reference(devices, (name, key), other, kind, source)
    return devices


def _read_device(name: str, table: Any, source: TableSource) -> DriverOptions:
    path = ("devices", name)
    if not NAME.fullmatch(name):
        source.refuse(path, "must have a name of at most 64 letters, digits, - and _", "rename it")
    driver = require_table(table, source, path).get("driver")
    if not isinstance(driver, str) or driver not in drivers():
        near = get_close_matches(str(driver), drivers(), 1)
        remedy = f'write driver = "{near[0]}"' if near else f"use one of {', '.join(drivers())}"
        missing = "is missing" if driver is None else f"must be the name of a driver; it is {shown(driver)}"
        source.refuse((*path, "driver"), missing, remedy)
    options = {key: value for key, value in table.items() if key != "driver"}
    return read_model(options_of(driver), options, source, path)


def named(options: DriverOptions) -> list[tuple[str, str, str]]:
    """Key, name and kind of each device that these options name."""
    devices = []
    for one in fields_of(type(options)):
        if kind := one.extra("kind"):
            value = getattr(options, one.name)
            devices += [(one.name, name, kind) for name in (value if one.several else (value,)) if name is not None]
    return devices


def _check_reference(
    devices: Mapping[str, DriverOptions], path: tuple[str, str], name: str, kind: str, source: TableSource
) -> None:
    other, key = devices.get(name), path[1]
    if other is not None and kind in other.provides:
        return
    good = [name for name, its in devices.items() if kind in its.provides]
    given = getattr(devices[path[0]], key)
    many = isinstance(given, tuple)
    remedy = f"add a table of a {kind}: {', '.join(one for one in drivers() if kind in options_of(one).provides)}"
    if good:
        remedy = f"write {key} = {toml_value(good[:1] if many else good[0])}"
    missing = "there is no such device" if other is None else f"{name} is not a {kind}"
    source.refuse(("devices", *path), f"must name a {kind}; it is {shown(given)}, and {missing}", remedy)


Tables = Mapping[str, Mapping[str, Any]]

WHICH = (
    "driver", "port", "server", "device", "switch", "camera", "model", "config", "folder", "on", "box", "shutter",
    "name", "letter", "axis", "motor", "module", "channel", "focuser", "part",
)  # fmt: skip
"""Keys of a device and its axes that identify the hardware; other keys set its use."""


def bench_differences(before: Tables, now: Tables) -> list[str]:
    """The differences in hardware, as text; empty if both configurations open the same bench."""
    old, new = dict(_which(before)), dict(_which(now))
    keys = dict.fromkeys([*old, *new])
    return [
        f"{key} was {old.get(key, 'absent')}, is {new.get(key, 'absent')}"
        for key in keys
        if old.get(key) != new.get(key)
    ]


def _which(tables: Tables) -> Iterator[tuple[str, str]]:
    for name, table in tables.items():
        rows = [("", table), *((f".axes[{n}]", row) for n, row in enumerate(table.get("axes", ()), 1))]
        for place, row in rows:
            for key in WHICH:
                if key in row:
                    yield f"devices.{name}{place}.{key}", repr(row[key])
