"""GRBL and grblHAL as their makers have them, with motors, switches and a power supply."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from drivers.errors import SystemClock
from drivers.grbl import GrblStage
from drivers.protocols.grbl import GrblAxis, GrblParser
from drivers.transport import SerialTransport, register_scheme
from simulators.devices.serial_device import Cable, plug, unplug
from simulators.world.clock import VirtualClock

from .grbl_firmware import FirmwareInSimavr
from .grblhal_simulator import GrblHalSimulator
from .rig import Rig

GRBL_AXES = [GrblAxis("z_mm", "X", 3000.0, travel=1500.0), GrblAxis("x_mm", "Y", 1500.0, travel=300.0)]
Options = Callable[[str], Any]
"""The value of an option by its name."""


class CabledGrbl:
    """A twin, or a firmware in simavr, at the end of a cable; `places` gives where its axes are."""

    line_stays = True

    def __init__(self, cable: Cable, places: Callable[[float], tuple[float, ...]]) -> None:
        self._cable, self._places = cable, places

    def cut_power(self, off_s: float, with_line: bool) -> None:
        """Switch it off, and on again so much later."""
        if with_line:
            faults, now_s = self._cable.faults, self._cable.clock.now_s()
            faults.unplugged_at_s, faults.replugged_at_s = now_s, now_s + off_s
        device: Any = self._cable.device
        self._cable.happen(lambda now_s: device.restart(now_s, off_s))

    def set(self, *lines: str) -> None:
        """Write settings, from somewhere else: each has its time, GRBL hears nothing while it writes."""
        for line in lines:
            self._cable.happen(partial(self._cable.device.receive, line.encode() + b"\n"))
            self._cable.clock.sleep(0.5)

    def standing(self) -> tuple[float, ...]:
        """Where its axes are."""
        reported: list[tuple[float, ...]] = []
        self._cable.happen(lambda now_s: reported.append(self._places(now_s)))
        return reported[0]


def _simavr(options: Options, folder: Path) -> Iterator[Rig]:
    """GRBL in simavr."""
    settings = tuple(options("--grbl-settings").split())
    firmware, clock = FirmwareInSimavr(options("--grbl-firmware"), options("--grbl-box"), settings), VirtualClock()
    register_scheme("simulators.devices")
    cable = Cable(firmware, clock)
    plug("firmware/stage", cable)
    stage = GrblStage(SerialTransport("sim://firmware/stage", GrblParser, clock=clock), GRBL_AXES, clock=clock)
    try:
        yield Rig(stage, clock, None, machine=CabledGrbl(cable, firmware.places))
    finally:
        stage.close()
        unplug("firmware/stage")
        firmware.end()


def _simulator(options: Options, folder: Path) -> Iterator[Rig]:
    """grblHAL's simulator."""
    simulator = GrblHalSimulator(options("--grblhal"), folder, tuple(options("--grbl-settings").split()))
    stage = GrblStage(SerialTransport(simulator.url, GrblParser), GRBL_AXES)
    try:
        yield Rig(stage, SystemClock(), None, machine=simulator)
    finally:
        stage.close()
        simulator.end()


REAL = {"grbl-firmware": _simavr, "grblhal": _simulator}
"""By the option that gives their program."""
