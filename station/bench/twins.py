"""Twins of stages: simulated controllers, each at the end of a cable, that `station conform` tries their drivers at."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from drivers.errors import BadConfiguration
from drivers.transport import register_scheme
from simulators.bench.bench import Setup, SimulatedBench
from simulators.devices.alpaca import AlpacaFocusers
from simulators.devices.gcs import GcsTwin
from simulators.devices.newport import Esp301Twin, Smc100Twin
from simulators.devices.serial_device import Cable, SerialDevice, SimClock, plug, unplug
from simulators.devices.thorlabs import AptTwin
from simulators.devices.tmcl import TmclModule
from simulators.world.clock import VirtualClock
from simulators.world.motion import Axis
from station.bench.device_models import BUILTIN, drivers, options_of
from station.bench.opening import simulated_tables


class Twin(SerialDevice, Protocol):
    """A simulated stage at byte level, with its axes by their names, and its main switch."""

    @property
    def axes(self) -> Mapping[str, Axis]:
        """Its axes, the truth about their positions."""

    def restart(self, now_s: float) -> None:
        """Off and on again: the reference is lost."""


@dataclass(frozen=True)
class TwinSetup:
    """A twin in place: the table of its driver, its clock, its axes, its line."""

    table: Mapping[str, Any]
    clock: SimClock
    axes: Mapping[str, Axis]
    cable: Cable | AlpacaFocusers


ALPACA = {"axes": [{"name": "z_mm", "focuser": 0, "home": "Home"}, {"name": "x_mm", "focuser": 1, "home": "Home"}]}
BUILT_IN = {"grbl": "stage", "zaber": "head"}
"""Drivers whose twin is a device of the simulated bench."""
TWINS: dict[str, tuple[Callable[[], Twin], dict[str, Any]]] = {
    "esp301": (Esp301Twin, {"axes": [{"name": "x_mm", "number": 1}, {"name": "y_mm", "number": 2}]}),
    "smc100": (Smc100Twin, {"axes": [{"name": "x_mm", "number": 1}, {"name": "y_mm", "number": 2}]}),
    "apt": (
        AptTwin,
        {
            "axes": [
                {"name": "x_mm", "number": 1, "scale": 1 / 34304, "travel": [0.0, 50.0]},
                {"name": "y_mm", "number": 2, "scale": 1 / 34304, "travel": [0.0, 25.0]},
            ]
        },
    ),
    "gcs": (GcsTwin, {"axes": [{"name": "x_mm", "number": "1"}, {"name": "y_mm", "number": "2"}]}),
    "tmcl_stage": (
        TmclModule,
        {"baud": 9600, "axes": [{"name": "z_mm", "motor": 0, "travel": [0.0, 300.0], "unit_per_step": 1 / 320}]},
    ),
}
"""Drivers with a twin of their own, and the rest of their table."""


def _twins() -> dict[str, tuple[Callable[[], Twin], dict[str, Any]]]:
    added = ((name, options_of(name).twin) for name in drivers() if name not in BUILTIN)
    return {**TWINS, **{name: (twin, {}) for name, twin in added if twin is not None}}


@contextmanager
def twin_of(driver: str, folder: Path) -> Iterator[TwinSetup]:
    """The twin of a driver. Raises BadConfiguration where it has none."""
    if driver in BUILT_IN:
        bench = SimulatedBench(folder, Setup(virtual_time=True))
        name = BUILT_IN[driver]
        try:
            table = simulated_tables(bench.address, folder)[name]
            yield TwinSetup(table, bench.clock, bench.world.axes, bench.cables[name])
        finally:
            bench.close()
        return
    if driver == "alpaca_stage":
        focusers = AlpacaFocusers(clock := VirtualClock())
        try:
            table = {"driver": driver, "server": f"127.0.0.1:{focusers.port}", **ALPACA}
            yield TwinSetup(table, clock, focusers.axes, focusers)
        finally:
            focusers.close()
        return
    make, options = _twins().get(driver, (None, {}))
    if make is None:
        remedy = f"name a real one by --device or --port, or one of {', '.join([*BUILT_IN, 'alpaca_stage', *_twins()])}"
        raise BadConfiguration(f"{driver} has no twin", remedy)
    twin, clock = make(), VirtualClock()
    register_scheme("simulators.devices")
    plug("conform/stage", cable := Cable(twin, clock))
    try:
        yield TwinSetup({"driver": driver, "port": "sim://conform/stage", **options}, clock, twin.axes, cable)
    finally:
        unplug("conform/stage")
