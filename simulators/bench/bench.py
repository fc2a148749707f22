"""A whole simulated bench: one world, its devices on cables, and a camera body that writes RAW files.

Every cable is reachable as `sim://NAME/DEVICE`; `simulators.devices.ports` makes them available to other programs.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from drivers.transport import register_scheme
from simulators.bench.body import BodySettings, CameraBody, Opening
from simulators.bench.device_faults import FaultEvent, FaultPlan, random_fault_events, random_faults
from simulators.bench.simulated_operator import Person, SimulatedActions
from simulators.bench.view import View
from simulators.bench.voice_coils import VoiceCoils
from simulators.camera.camera import SimulatedCamera
from simulators.camera.subjects import SUBJECTS
from simulators.devices.cable_faults import Faults
from simulators.devices.grbl import GrblController
from simulators.devices.grbl_state import Outputs
from simulators.devices.imu import FastModule, WitModule, box_reading
from simulators.devices.instruments import BoschModule, DmxWidget, JrtModule
from simulators.devices.ports import PtyPort, TcpPort
from simulators.devices.scpi import ScpiTwin
from simulators.devices.serial_device import Cable, SerialDevice, SimClock, plug, unplug
from simulators.devices.shutter import RtsLine, StrigBox
from simulators.devices.zaber import ZaberChain
from simulators.world.clock import FastClock, VirtualClock
from simulators.world.world import SinusoidalDrive, World, WorldParameters

_numbers = itertools.count(1)
CABLES = ("stage", "head", "shutter", "rts", "imu", "fast_imu", "rangefinder", "bosch", "light", "room")
Develop = Callable[[Opening], bytes]
UNIT_PER_STEP = {"pan_deg": 0.000234375, "tilt_deg": 0.000234375, "y_mm": 0.00049609375}


@dataclass(frozen=True)
class Setup:
    """Configuration of a simulated bench.

    `faults` by cable, `fault_events` of devices; `develop` makes the RAW file of an opening, by default a rendering of
    the chart. With `virtual_time` time jumps during waits; otherwise it runs `speed` times as fast as real time. With
    `motors_on_box` the motors of rail and height are powered only while the box's enable output is set.
    """

    seed: int = 0
    room: WorldParameters = field(default_factory=WorldParameters)
    body: BodySettings = field(default_factory=BodySettings)
    faults: Mapping[str, Faults] = field(default_factory=dict)
    develop: Develop | None = None
    fault_events: tuple[FaultEvent, ...] = ()
    virtual_time: bool = False
    speed: float = 1.0
    motors_on_box: bool = False


class SimulatedBench:
    """Rail and height on GRBL, a pan-tilt head on Zaber, a STRIG/4 box, body, shaker, two IMUs and lasers, a lamp.

    A probe measures the room.
    """

    def __init__(self, folder: Path, setup: Setup | None = None) -> None:
        setup = setup or Setup()
        self.clock: SimClock = VirtualClock() if setup.virtual_time else FastClock(setup.speed)
        self.world = World(setup.room)
        self.folder = folder
        self._seed = setup.seed
        root = np.random.default_rng(setup.seed)
        sensing, picture = root.spawn(2)
        self.view = View(self.world, picture)
        self.subject = "chart"
        self._usual_camera: SimulatedCamera | None = None
        self.motions: tuple[tuple[SinusoidalDrive, ...], ...] = ()
        self._room = setup.room
        self._motors_on_box = setup.motors_on_box
        develop = setup.develop or self.view.develop
        self.body = CameraBody(self.world, folder, develop, self.clock, replace(setup.body))
        self.clock.attach(self.body)
        self.devices = self._devices(sensing)
        self.name = f"bench{next(_numbers)}"
        self.cables = {name: Cable(device, self.clock, setup.faults.get(name)) for name, device in self.devices.items()}
        self._fault_plan = FaultPlan(self.body, self.cables, self.clock, setup.fault_events)
        self._ports: list[PtyPort | TcpPort] = []
        register_scheme("simulators.devices")
        for name, cable in self.cables.items():
            plug(f"{self.name}/{name}", cable)

    def _devices(self, rng: np.random.Generator) -> dict[str, SerialDevice]:
        axes, seeds = self.world.axes, rng.spawn(5)
        outputs = Outputs(self._relay, self.world.set_lamp)
        chain = {number: [(axes[name], UNIT_PER_STEP[name])] for number, name in ((1, "pan_deg"), (2, "tilt_deg"))}
        return {
            "stage": GrblController({"X": axes["z_mm"], "Y": axes["x_mm"], "Z": axes["y_mm"]}, outputs=outputs),
            "head": ZaberChain(chain),
            "shutter": StrigBox(
                self.body,
                actuators=VoiceCoils(self.world),
                enable=self._enable,
                inertial=partial(box_reading, self.world, seeds[4]),
            ),
            "rts": RtsLine(self.body),
            "imu": WitModule(self.world, seeds[0]),
            "fast_imu": FastModule(self.world, seeds[1]),
            "rangefinder": JrtModule(self.world, seeds[2]),
            "bosch": BoschModule(self.world, seeds[3]),
            "light": DmxWidget(self.world),
            "room": ScpiTwin(self.world),
        }

    @cached_property
    def hands(self) -> SimulatedActions:
        """The operator model, which begins with an empty room; without it the chart hangs straight and in focus."""
        width_mm = None if self.subject == "tilt" else Person.width_mm
        return SimulatedActions(self, self._seed, Person(width_mm))

    def show(self, subject: str) -> None:
        """Photograph one of `SUBJECTS`; the operator model restarts when the subject changes."""
        if subject == self.subject:
            return
        self.__dict__.pop("hands", None)
        chosen = SUBJECTS[subject](np.random.default_rng(self._seed))
        self.subject, self.view.sheets, self.motions = subject, chosen.sheets, chosen.motions
        self.view.held = replace(self.view.held, slopes=chosen.slopes)
        usual, self._usual_camera = self._usual_camera or self.view.camera, None
        if chosen.camera is not None:
            self._usual_camera = usual
        camera = chosen.camera or usual
        self.view.camera = replace(camera, lens=replace(camera.lens, f_number=chosen.f_number))
        arm_mm = float("inf") if chosen.motions else self._room.arm_mm
        self.world.room = replace(self._room, arm_mm=arm_mm, near_mm=chosen.near_mm or self._room.near_mm)

    def _enable(self, on: bool, now_s: float) -> None:
        if self._motors_on_box:
            for name in ("z_mm", "x_mm", "y_mm"):
                self.world.axes[name].power(on, now_s)

    def _relay(self, on: bool, now_s: float) -> None:
        if on:
            self.body.close(now_s)
        else:
            self.body.release(now_s)

    def address(self, device: str) -> str:
        """The URL of a device's port."""
        return f"sim://{self.name}/{device}"

    def open_ports(self, devices: Sequence[str] = CABLES) -> dict[str, tuple[str, str]]:
        """Pseudo-terminal and TCP address of each cable for other programs; the bare RTS line has neither.

        A cable serves one program at a time.
        """
        addresses = {}
        for name, cable in self.cables.items():
            if name != "rts" and name in devices:
                pty = PtyPort(cable) if hasattr(os, "openpty") else None
                tcp = TcpPort(cable)
                self._ports += [tcp, *([pty] if pty else [])]
                addresses[name] = (pty.address if pty else "", tcp.address)
        return addresses

    def close(self) -> None:
        """Close the ports and unregister the cables."""
        for port in self._ports:
            port.end()
        for port in self._ports:
            port.close()
        for name, cable in self.cables.items():
            unplug(f"{self.name}/{name}")
            self.clock.detach(cable)
        self.clock.detach(self.body)
        self.clock.detach(self._fault_plan)


def random_trouble(seed: int) -> tuple[dict[str, Faults], tuple[FaultEvent, ...]]:
    """Random faults of cables and devices within the first minutes of a bench."""
    cables, devices = np.random.default_rng(seed).spawn(2)
    return random_faults(cables, CABLES), tuple(random_fault_events(devices))
