"""Random faults of a bench's cables and devices, from a seed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simulators.bench.body import CameraBody
from simulators.devices.cable_faults import Faults
from simulators.devices.grbl import GrblController
from simulators.devices.instruments import JrtModule
from simulators.devices.serial_device import Cable, SimClock
from simulators.devices.shutter import StrigBox
from simulators.devices.zaber import ZaberChain
from simulators.world.clock import EventSource

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
        """Time of the next fault."""
        return self._due[0].moment_s if self._due else None

    def wake(self) -> None:
        """Inject the faults that are due."""
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
