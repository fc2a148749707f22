"""Motions of a bench: every move and homing passes here, so that observers can display it; and its emergency stop."""

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from drivers.errors import Clock
from drivers.interfaces import Device
from drivers.wire.connection import Transcript


@dataclass(frozen=True)
class Motion:
    """A move in progress: its start by the bench's clock, and its targets by axis; no targets for homing."""

    began_s: float
    target: Mapping[str, float] = field(default_factory=dict)


class Motions:
    """The moves of a bench's stages; thread-safe."""

    def __init__(self, devices: Mapping[str, Device], clock: Clock) -> None:
        self._devices, self._clock = devices, clock
        self._lock = threading.Lock()
        self._now: dict[str, Motion] = {}
        self._ended: dict[str, Motion] = {}

    def motion_of(self, name: str) -> Motion | None:
        """The present motion of this stage; None if it stands still."""
        with self._lock:
            return self._now.get(name)

    @property
    def under_way(self) -> bool:
        """Whether any stage moves."""
        with self._lock:
            return bool(self._now)

    def take_ended(self, name: str) -> Motion | None:
        """The move of this stage that has ended, successfully or not, since the last call."""
        with self._lock:
            return self._ended.pop(name, None)

    def move(self, name: str, target: Mapping[str, float]) -> None:
        """Move a stage and wait until it arrives. Raises DeviceError."""
        with self._moving(name, target) as stage:
            stage.move_to(**target)

    def home(self, name: str, allowed: Callable[[], None]) -> None:
        """Home a stage. Raises DeviceError, and what `allowed` raises."""
        with self._moving(name, {}) as stage:
            stage.home(allowed)

    @contextmanager
    def _moving(self, name: str, target: Mapping[str, float]) -> Iterator[Any]:
        motion = Motion(self._clock.now_s(), dict(target))
        with self._lock:
            self._now[name] = motion
        try:
            yield self._devices[name]
        finally:
            with self._lock:
                self._now.pop(name, None)
                self._ended[name] = motion


PATIENCE_S = 0.25
"""How long a stop waits for blocked ports; their threads continue trying."""


@dataclass(frozen=True)
class StopRecord:
    """A stop requested at this time; `done` is set once every device was stopped or its stop is in progress."""

    at_s: float
    done: threading.Event = field(default_factory=threading.Event)


@dataclass(frozen=True)
class StopRequest:
    """One stop of the bench: time of the request, and time of the stop bytes on each line; None: not sent yet."""

    asked_s: float
    wires: Mapping[str, float | None]

    def record(self) -> dict[str, Any]:
        """For the session's journal: times by the bench's clock, delays in milliseconds."""
        delays = {n: None if t is None else round(1000 * (t - self.asked_s), 3) for n, t in self.wires.items()}
        return {"asked_s": self.asked_s, "on_the_wire_s": dict(self.wires), "after_ms": delays}


def stop_all(devices: Iterable[Device]) -> None:
    """Stop these devices simultaneously, in this order if threads start slowly; thread-safe."""
    threads = [threading.Thread(target=device.emergency_stop, name="stop", daemon=True) for device in devices]
    begun = [thread for thread in threads if _begin(thread)]  # each has mostly finished when the next one begins
    for thread in begun:
        thread.join(PATIENCE_S / len(begun))


def _begin(thread: threading.Thread) -> bool:
    """Start the thread; if there are no more threads, run its work here and return False."""
    try:
        thread.start()
    except RuntimeError:
        thread.run()
        return False
    return True


def stops_on_wires(stops: Sequence[StopRecord], transcripts: Mapping[str, Transcript]) -> list[StopRequest]:
    """These stops, once done, with the time at which each line sent their bytes; lines without stop bytes are omitted.
    A port that refused the bytes has None."""
    for stop in stops:
        stop.done.wait(2 * PATIENCE_S)
    requests = []
    for stop in stops:
        sent: dict[str, float | None] = {}
        for name, transcript in transcripts.items():
            tries = [entry for entry in transcript.last() if entry.way in "!x" and entry.time_s >= stop.at_s]
            if tries:
                sent[name] = next((entry.time_s for entry in tries if entry.way == "!"), None)
        requests.append(StopRequest(stop.at_s, sent))
    return requests
