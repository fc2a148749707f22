"""A whole simulated bench: one world, its devices on cables, and a camera body that writes RAW files.

Every cable is reachable as `sim://NAME/DEVICE`; `simulators.devices.ports` makes them available to other programs.
"""

import itertools
import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from drivers.transport import register_scheme
from simulators.bench.body import BodySettings, CameraBody, Opening, VoiceCoils
from simulators.bench.simulated_operator import Person, SimulatedActions
from simulators.bench.view import View
from simulators.camera.camera import SimulatedCamera
from simulators.camera.sheets import SUBJECTS
from simulators.devices.grbl import GrblController
from simulators.devices.grbl_motion import Outputs
from simulators.devices.imu import FastModule, WitModule, box_reading
from simulators.devices.instruments import BoschModule, DmxWidget, JrtModule, ScpiTwin
from simulators.devices.ports import PtyPort, TcpPort
from simulators.devices.serial_device import Cable, Faults, SerialDevice, SimClock, plug, unplug
from simulators.devices.shutter import RtsLine, StrigBox
from simulators.devices.zaber import ZaberChain
from simulators.world.clock import EventSource, FastClock, VirtualClock
from simulators.world.world import SinusoidalDrive, World, WorldParameters

_numbers = itertools.count(1)
CABLES = ("stage", "head", "shutter", "rts", "imu", "fast_imu", "rangefinder", "bosch", "light", "room")
Develop = Callable[[Opening], bytes]
UNIT_PER_STEP = {"pan_deg": 0.000234375, "tilt_deg": 0.000234375, "y_mm": 0.00049609375}


@dataclass(frozen=True)
class Setup:
    """Configuration of a simulated bench.

    `faults` by cable, `fault_events` of devices; `develop` makes the RAW file of an opening, by default a rendering of
    the chart. Time runs `speed` times as fast as real time; with `virtual_time` only waits do, none at speed 1. With
    `motors_on_box` the motors of rail and height are powered only while the box's enable output is set.
    """

    seed: int = 0
    room: WorldParameters = field(default_factory=WorldParameters)
    body: BodySettings = field(default_factory=BodySettings)
    faults: Mapping[str, Faults] = field(default_factory=dict)
    develop: Develop | None = None
    fault_events: "tuple[FaultEvent, ...]" = ()
    virtual_time: bool = False
    speed: float = 1.0
    motors_on_box: bool = False


class SimulatedBench:
    """Rail and height on GRBL, a pan-tilt head on Zaber, a STRIG/4 box, body, shaker, two IMUs and lasers, a lamp.

    A probe measures the room.
    """

    def __init__(self, folder: Path, setup: Setup | None = None) -> None:
        setup = setup or Setup()
        self.clock: SimClock = FastClock(setup.speed)
        if setup.virtual_time:
            self.clock = VirtualClock(math.inf if setup.speed == 1.0 else setup.speed)
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
        outputs = Outputs(
            lambda on, now_s: self.body.close(now_s) if on else self.body.release(now_s), self.world.set_lamp
        )
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

    def address(self, device: str) -> str:
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


def random_trouble(seed: int) -> "tuple[dict[str, Faults], tuple[FaultEvent, ...]]":
    """Random faults of cables and devices within the first minutes of a bench."""
    cables, devices = np.random.default_rng(seed).spawn(2)
    return random_faults(cables, CABLES), tuple(random_fault_events(devices))


# --- Random faults of a bench's cables and devices, from a seed ---

CABLE_FAULTS = ("lost", "garbage", "duplicate", "delay", "silent", "unplugged", "replugged", "wrong_baud")
FAULT_KINDS = ("reset", "alarm", "box_reset", "stall", "range_error", "lose_frame", "half_frame")


@dataclass(frozen=True)
class FaultEvent:
    """A fault of a device at a given time."""

    moment_s: float
    kind: str
    number: int


def cable_fault(kind: str, rng: np.random.Generator) -> Faults:
    """Faults of one kind on a cable, beginning within the first two minutes."""
    begin_s = float(rng.uniform(0, 120))
    rate = float(10 ** rng.uniform(-3.5, -1.5))
    match kind:
        case "lost":
            return Faults(rng, begin_s=begin_s, lost=rate)
        case "garbage":
            return Faults(rng, begin_s=begin_s, garbage=rate)
        case "duplicate":
            return Faults(rng, begin_s=begin_s, duplicate=min(30 * rate, 0.3))
        case "delay":
            return Faults(rng, begin_s=begin_s, delay_s=float(rng.uniform(0.01, 2.0)))
        case "silent":
            return Faults(rng, silent=((begin_s, begin_s + float(rng.uniform(0.2, 60.0))),))
        case "unplugged":
            return Faults(rng, unplugged_at_s=begin_s)
        case "replugged":
            return Faults(rng, unplugged_at_s=begin_s, replugged_at_s=begin_s + float(rng.uniform(1, 60)))
        case "wrong_baud":
            return Faults(rng, wrong_baud=True)
    raise ValueError(f"fault must be one of {CABLE_FAULTS}; got {kind!r}")


def random_faults(rng: np.random.Generator, cables: Sequence[str]) -> dict[str, Faults]:
    """Faults of one kind on each of a random half of the cables."""
    return {
        name: cable_fault(str(stream.choice(CABLE_FAULTS)), stream)
        for name, stream in zip(cables, rng.spawn(len(cables)), strict=True)
        if stream.random() < 0.5
    }


def random_fault_events(rng: np.random.Generator, mean: float = 3.0) -> list[FaultEvent]:
    """Random faults of devices within 150 s."""
    return [
        FaultEvent(float(rng.uniform(0, 150.0)), str(rng.choice(FAULT_KINDS)), int(rng.integers(1, 5)))
        for _ in range(rng.poisson(mean))
    ]


class FaultPlan(EventSource):
    """Injects faults into a bench at their times."""

    def __init__(
        self, body: CameraBody, cables: Mapping[str, Cable], clock: SimClock, fault_events: Sequence[FaultEvent]
    ) -> None:
        self._body, self._cables, self._clock = body, cables, clock
        self._due = sorted(fault_events, key=lambda one: one.moment_s)
        for fault_event in fault_events:
            real_s = clock.real_s(fault_event.moment_s)
            if real_s is not None:
                timer = threading.Timer(real_s, self._inject, (fault_event,))
                timer.daemon = True
                timer.start()
        clock.attach(self)

    def next_event_s(self) -> float | None:
        return self._due[0].moment_s if self._due else None

    def wake(self) -> None:
        while self._due and self._due[0].moment_s <= self._clock.now_s():
            self._inject(self._due.pop(0))

    def _inject(self, fault_event: FaultEvent) -> None:
        body = self._body
        stage, head, box, laser = (self._cables[name].device for name in ("stage", "head", "shutter", "rangefinder"))
        assert isinstance(stage, GrblController)
        assert isinstance(head, ZaberChain)
        assert isinstance(box, StrigBox)
        assert isinstance(laser, JrtModule)
        number = fault_event.number
        acts: dict[str, tuple[str, Callable[[float], None]]] = {
            "reset": ("stage", stage.restart),
            "alarm": ("stage", lambda now_s: stage.alarm((1, 3, 10, 17)[number - 1], now_s)),
            "box_reset": ("shutter", box.restart),
            "stall": ("head", lambda now_s: setattr(head.devices[1].motors[0], "stalls", True)),
            "range_error": ("rangefinder", lambda now_s: setattr(laser, "status", (1, 4, 7, 8)[number - 1])),
        }
        coming = frozenset({len(body.openings) + number})
        if fault_event.kind == "lose_frame":
            body.settings.lose_frames |= coming
        elif fault_event.kind == "half_frame":
            body.settings.half_frames |= coming
        else:
            name, act = acts[fault_event.kind]
            self._cables[name].happen(act)
