"""Current motions of a bench: every move and homing passes here, so that observers can display it."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from drivers.errors import Clock
from drivers.interfaces import Device


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
