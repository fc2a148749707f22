"""Errors of devices: each states what was required, what was received, and the remedy.

Every class is a situation that an operator meets, not a layer of the program.
"""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Protocol, Self


class DeviceError(Exception):
    """A device cannot do what was requested: what happened (`reason`) and what to do (`remedy`)."""

    exit_code = 3

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(f"{reason}; {remedy}")
        self.reason = reason
        self.remedy = remedy

    def with_remedy(self, remedy: str) -> Self:
        """This error with another remedy."""
        other = type(self).__new__(type(self), f"{self.reason}; {remedy}")
        vars(other).update(vars(self), remedy=remedy)
        return other


class NotConnected(DeviceError):
    """All devices that did not answer, collected, so that the operator can correct them together."""

    def __init__(self, failures: Mapping[str, DeviceError]) -> None:
        self.failures = dict(failures)
        listed = "; ".join(f"{name}: {error.reason}" for name, error in failures.items())
        remedies = "; ".join(f"{name}: {error.remedy}" for name, error in failures.items())
        super().__init__(f"{len(self.failures)} devices are not connected ({listed})", remedies)


class BadConfiguration(DeviceError):
    """The configuration or the argument is not valid for this device."""

    exit_code = 2


class NoAnswer(DeviceError):
    """No reply before the deadline."""


class LineLost(DeviceError):
    """The port is closed, unplugged, or owned by another program."""


class Rejected(DeviceError):
    """The device understood the command and refused it."""

    def __init__(self, reason: str, remedy: str, code: str = "") -> None:
        super().__init__(reason, remedy)
        self.code = code


class Alarm(Rejected):
    """The device stopped itself and is locked; its position may be lost."""


class WasReset(DeviceError):
    """The device restarted during operation; its position is lost."""


class NotHomed(DeviceError):
    """A move before homing, or after the position was lost."""


class OutsideTravel(DeviceError):
    """A target beyond the travel of an axis."""


class Held(DeviceError):
    """A person has paused the machine: the safety door is open, or feed hold was pressed. The position is kept."""


class MoveFailed(DeviceError):
    """The axis is still, but not at its target: stopped, stalled, or a command was garbled."""


class EmergencyStopped(DeviceError):
    """An emergency stop interrupted the operation; nothing moves until the stage is homed again."""


class FrameMissing(DeviceError):
    """The exposure was made, but no complete RAW file came in time."""


class FrameWrong(DeviceError):
    """A file came, but it is not the requested exposure."""


class NoReading(DeviceError):
    """The instrument reports that it cannot measure now."""

    def __init__(self, reason: str, remedy: str, code: int = -1) -> None:
        super().__init__(reason, remedy)
        self.code = code


# --- Time as an argument: drivers use a clock object, so that tests and simulated benches need not wait ---


class Clock(Protocol):
    """Seconds since a fixed moment, and waiting."""

    def now_s(self) -> float:
        """Seconds; monotonic."""

    def sleep(self, duration_s: float) -> None:
        """Return after `duration_s` seconds."""

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait, holding `condition`, until `ready()` or the deadline; returns the last value of `ready()`."""


class SystemClock:
    """The machine's monotonic clock."""

    def now_s(self) -> float:
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        time.sleep(max(duration_s, 0.0))

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        return condition.wait_for(ready, max(deadline_s - time.monotonic(), 0.0))
