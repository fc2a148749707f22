"""What every kind of device promises. A driver has these methods; it inherits from nothing.

Positions are given by the axis' name, which carries the unit (`z_mm`, `pan_deg`); times are seconds of the clock
the driver was given. Every method that waits has a deadline and ends in success or in a `DeviceError`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

E_co = TypeVar("E_co", covariant=True)
T = TypeVar("T")


@dataclass(frozen=True)
class Identity:
    """What answered: model, firmware, serial number if it tells one, and the address it answered at."""

    model: str
    firmware: str
    serial: str
    address: str


@dataclass(frozen=True)
class Travel:
    """The range of one axis, in the unit its name carries."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Whether `value` lies inside; NaN does not."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class ShutterTimes:
    """When the contacts closed and opened, and when the hot shoe fired (None where it is not wired)."""

    closed_s: float
    released_s: float
    flash_s: float | None = None


@dataclass(frozen=True)
class CameraSettings:
    """What the body is set to; None leaves a setting as it is."""

    exposure_s: float | None = None
    iso: int | None = None
    f_number: float | None = None


@dataclass(frozen=True)
class ExposedFile:
    """One RAW file on disk with the record of how it came to be."""

    path: Path
    sha256: str
    size_bytes: int
    settings: CameraSettings
    requested_s: float
    received_s: float
    shutter: ShutterTimes | None = None
    companions: tuple[Path, ...] = ()


@dataclass(frozen=True)
class ImuBlock:
    """Samples since the last block: (n,) times by both clocks, (n, 3) m/s^2, (n, 3) rad/s, samples known lost."""

    device_s: NDArray[np.float64]
    host_s: NDArray[np.float64]
    acceleration_m_s2: NDArray[np.float64]
    rotation_rad_s: NDArray[np.float64]
    lost: int


@dataclass(frozen=True)
class ShakePath:
    """One round of a path about rest, played around and around: offsets by axis, in its unit, `interval_s` apart."""

    interval_s: float
    offsets: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Distance:
    """One laser reading from the housing's reference plane; lower `quality` is better, None where none is told."""

    distance_mm: float
    measured_s: float
    quality: int | None = None


@dataclass(frozen=True)
class Doubt:
    """Why what a device tells deserves less trust although it may be used, and what to do about that."""

    reason: str
    remedy: str


@dataclass(frozen=True)
class Condition:
    """One word for the device's row, whether it may be used, what to do where it may not, and a doubt where it may."""

    word: str
    usable: bool = True
    remedy: str = field(default="")
    doubt: Doubt | None = None


class Device(Protocol):
    """What all of them promise."""

    @property
    def address(self) -> str:
        """Where it is: a port, a URL or a folder."""
        ...

    def connect(self) -> Identity:
        """Open the line and ask who is there. Raises DeviceError."""
        ...

    def condition(self) -> Condition:
        """What it is doing, without asking the wire."""
        ...

    def emergency_stop(self) -> None:
        """Make it harmless now; from any thread, waiting for no lock, any number of times; never raises."""
        ...

    def close(self) -> None:
        """Give the line back; any number of times."""
        ...


class Stage(Device, Protocol):
    """Axes that move: rails, gantries, pan-tilt heads. Homes before it moves, and moves inside its travel only."""

    def travel(self) -> Mapping[str, Travel]:
        """The range of each axis; known after `connect`."""
        ...

    def home(self, allowed: Callable[[], None] = ...) -> None:
        """Find the reference; the only motion allowed before it. Raises DeviceError, and what `allowed` does.

        `allowed` raises why homing may not begin: it is asked when no stop can come between any more.
        """
        ...

    def move_to(self, **target: float) -> None:
        """Go there and return when still. Raises DeviceError."""
        ...

    def position(self) -> Mapping[str, float]:
        """Where the axes are now, asked from the device."""
        ...

    def moving(self) -> bool:
        """Whether any axis moves, asked from the device."""
        ...

    def stop(self) -> None:
        """Slow down and stay, keeping the position; a `move_to` that waits elsewhere ends in MoveFailed."""
        ...


class Shutter(Device, Protocol):
    """Something that closes the camera's release contact."""

    def focus(self, pressed: bool) -> None:
        """Half-press or let go. Raises DeviceError."""
        ...

    def fire(self, pulse_s: float, focus_s: float = 0.0) -> ShutterTimes:
        """Half-press for `focus_s`, close the contact for `pulse_s`, and say when. Raises DeviceError."""
        ...

    def abort(self) -> None:
        """Open the contact now. Raises DeviceError."""
        ...


class Camera(Device, Protocol):
    """Something that answers a request with a RAW file."""

    def configure(self, settings: CameraSettings) -> None:
        """Set, or expect, these settings. Raises DeviceError."""
        ...

    def expose(self) -> ExposedFile:
        """Take one photograph and return its RAW file, complete, decodable and hashed. Raises DeviceError."""
        ...


class Imu(Device, Protocol):
    """Acceleration and rotation rate, streamed."""

    def start(self, rate_hz: float) -> None:
        """Stream at this rate. Raises DeviceError."""
        ...

    def stop(self) -> None:
        """Stream no more. Raises DeviceError."""
        ...

    def read_block(self, duration_s: float) -> ImuBlock:
        """Samples that arrived since the last block and in the next `duration_s`. Raises DeviceError."""
        ...


class Rangefinder(Device, Protocol):
    """A laser that measures distance."""

    def measure(self) -> Distance:
        """One reading. Raises DeviceError."""
        ...

    def laser(self, on: bool) -> None:
        """Switch the spot, for aiming. Raises DeviceError."""
        ...


class Light(Device, Protocol):
    """A panel that lights the chart."""

    def set_level(self, level: float) -> None:
        """Set to `level` in [0, 1] of full light. Raises DeviceError."""
        ...

    def level(self) -> float:
        """What it was last set to."""
        ...


class Shaker(Device, Protocol):
    """Something that carries the camera around a path that it is told, while it photographs."""

    def strokes(self) -> Mapping[str, float]:
        """How far each axis goes from rest, both ways."""
        ...

    def start(self, path: ShakePath) -> ShakePath:
        """Play this path until `stop`; the path as it is really commanded. Raises DeviceError."""
        ...

    def began_s(self) -> float:
        """When the first point was put out, by the same clock and at the same comparison of clocks as the last shot."""
        ...

    def stop(self) -> None:
        """Come to rest at the end of the round. Raises DeviceError."""
        ...


class Parser(Protocol[E_co]):
    """Pure bytes to events: any split of the stream gives the same events, garbage never raises."""

    def feed(self, data: bytes) -> Sequence[E_co]:
        """The events completed by these bytes."""
        ...


class Transport(Protocol[E_co]):
    """A line to a device: requests under a lock and a deadline, and a way past both for emergencies."""

    @property
    def address(self) -> str:
        """The port or URL."""
        ...

    @property
    def is_open(self) -> bool:
        """Whether the port is owned and has not been lost."""
        ...

    def open(self, listen: Callable[[E_co, float], None]) -> None:
        """Own the port; `listen(event, host_s)` hears every event. Raises LineLost."""
        ...

    def close(self) -> None:
        """Give the port back and end the reader."""
        ...

    def request(
        self,
        data: bytes,
        answer: Callable[[E_co], T | None],
        timeout_s: float,
        tries: int = 1,
        allowed: Callable[[], None] = ...,
    ) -> T:
        """Write and wait until `answer(event)` is not None, `tries` times over. Raises NoAnswer, LineLost.

        `allowed` raises why the order may not be given: it is asked when nothing can come between any more.
        """
        ...

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for something the listener notes down. Raises LineLost, or what interrupted."""
        ...

    def write(self, data: bytes, *, noted: bool = True, within_s: float = ...) -> None:
        """Write without waiting for a reply, a request or a lock; the transcript has it if `noted`.

        Raises LineLost, NoAnswer where `within_s` was not enough.
        """
        ...

    def shout(self, data: bytes, error: Exception) -> None:
        """Drop what was not sent yet, write past every lock, and end all waits with `error`; never raises."""
        ...

    def set_lines(self, **lines: bool) -> None:
        """Set modem lines: rts=, dtr=. Raises LineLost."""
        ...
