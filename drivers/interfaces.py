"""Protocols of every kind of device. A driver has these methods; it does not inherit from them.

Positions are given by the axis' name, which carries the unit (`z_mm`, `pan_deg`); times are seconds of the clock
passed to the driver. Every method that waits has a deadline and ends in success or in a `DeviceError`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

E_co = TypeVar("E_co", covariant=True)
T = TypeVar("T")
PROBE_UNITS = {"temperature": "°C", "humidity": "%", "pressure": "hPa", "power": "W", "illuminance": "lx"}
"""Quantities of probes, and the unit of each."""


@dataclass(frozen=True)
class Identity:
    """Model, firmware, serial number if reported, and address of a connected device."""

    model: str
    firmware: str
    serial: str
    address: str


@dataclass(frozen=True)
class Travel:
    """The range of one axis, in the unit of its name."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Whether `value` lies inside; NaN does not."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class ShutterTimes:
    """When the contacts closed and opened, and when the hot shoe fired (None if it is not wired).

    within_s : bound of the error of all three on the host's clock; None where the host has only the command's times.
    """

    closed_s: float
    released_s: float
    flash_s: float | None = None
    within_s: float | None = None


@dataclass(frozen=True)
class CameraSettings:
    """Settings of the body; None leaves a setting unchanged."""

    exposure_s: float | None = None
    iso: int | None = None
    f_number: float | None = None


@dataclass(frozen=True)
class FrameFormat:
    """Size of a camera's frames, colours of their 2 x 2 tile (None: monochrome), largest number, pixel pitch."""

    columns: int
    rows: int
    cfa: str | None
    white: int
    pixel_pitch_um: float | None = None


@dataclass(frozen=True)
class ExposedFile:
    """One RAW file on disk with the record of its exposure."""

    path: Path
    sha256: str
    size_bytes: int
    settings: CameraSettings
    requested_s: float
    received_s: float
    shutter: ShutterTimes | None = None
    companions: tuple[Path, ...] = ()


@dataclass(frozen=True)
class ClockOffset:
    """Offset of the clocks, host minus device, and relative drift of the device's, each with a bound.

    by : what bounds it: "round trip", "common event", or "box" for the clock of a shutter box.
    """

    offset_s: float
    within_s: float
    drift: float
    drift_within: float
    by: str


@dataclass(frozen=True)
class ImuBlock:
    """Samples since the last block: (n,) times of both clocks, (n, 3) m/s^2, (n, 3) rad/s, number of lost samples.

    clock : how `host_s` follows from `device_s`; None if there are no samples.
    """

    device_s: NDArray[np.float64]
    host_s: NDArray[np.float64]
    acceleration_m_s2: NDArray[np.float64]
    rotation_rad_s: NDArray[np.float64]
    lost: int
    clock: ClockOffset | None = None


@dataclass(frozen=True)
class AxisResponse:
    """How an axis follows its command: gain, and the resonance that bounds it (None: it follows at any frequency).

    within_s : bound of the error of its phase, as a time; gain_uncertainty : of the gain, relative and standard.
    """

    gain: float = 1.0
    frequency_hz: float | None = None
    damping: float = 1.0
    within_s: float = 0.0
    gain_uncertainty: float = 0.0


@dataclass(frozen=True)
class ShakePath:
    """One round of a closed path about rest, played repeatedly: offsets by axis, in its unit, `interval_s` apart.

    response : of the axes whose response is known; the offsets are as commanded.
    """

    interval_s: float
    offsets: Mapping[str, tuple[float, ...]]
    response: Mapping[str, AxisResponse] = field(default_factory=dict)


@dataclass(frozen=True)
class Distance:
    """One laser reading from the housing's reference plane; lower `quality` is better, None if not reported."""

    distance_mm: float
    measured_s: float
    quality: int | None = None


@dataclass(frozen=True)
class ProbeReading:
    """One quantity of a probe: its value in `unit`, and its standard uncertainty, None if unknown."""

    value: float
    unit: str
    uncertainty: float | None = None


@dataclass(frozen=True)
class Caveat:
    """Why a usable device deserves less trust, and the remedy."""

    reason: str
    remedy: str


@dataclass(frozen=True)
class Condition:
    """The device's state in one word, whether it may be used, the remedy if it may not, and a caveat if it may."""

    word: str
    usable: bool = True
    remedy: str = field(default="")
    caveat: Caveat | None = None


class Device(Protocol):
    """The promises of every device."""

    @property
    def address(self) -> str:
        """Port, URL or folder."""

    def connect(self) -> Identity:
        """Open the line and identify the device. Raises DeviceError."""

    def condition(self) -> Condition:
        """Its current state, without communication."""

    def emergency_stop(self) -> None:
        """Make it harmless now; from any thread, without waiting for a lock, any number of times; never raises."""

    def close(self) -> None:
        """Release the line; any number of times."""


class Stage(Device, Protocol):
    """Axes that move: rails, gantries, pan-tilt heads. Homes before it moves, and moves only within its travel."""

    def travel(self) -> Mapping[str, Travel]:
        """The range of each axis; known after `connect`."""

    def home(self, allowed: Callable[[], None] = ...) -> None:
        """Find the reference; the only motion allowed before it. Raises DeviceError, and what `allowed` does.

        `allowed` raises why homing may not begin: it is called when no stop can intervene any more.
        """

    def move_to(self, **target: float) -> None:
        """Move and return when still. Raises DeviceError."""

    def position(self) -> Mapping[str, float]:
        """Current positions, read from the device."""

    def moving(self) -> bool:
        """Whether any axis moves, read from the device."""

    def stop(self) -> None:
        """Decelerate and stay, keeping the position; a waiting `move_to` ends in MoveFailed."""


class Shutter(Device, Protocol):
    """A device that closes the camera's release contact."""

    def focus(self, pressed: bool) -> None:
        """Half-press or release. Raises DeviceError."""

    def fire(self, pulse_s: float, focus_s: float = 0.0) -> ShutterTimes:
        """Half-press for `focus_s`, close the contact for `pulse_s`, and report the times. Raises DeviceError."""

    def abort(self) -> None:
        """Open the contact now. Raises DeviceError."""


class Camera(Device, Protocol):
    """A device that delivers one RAW file per request."""

    def sensor(self) -> FrameFormat | None:
        """The format of its frames; None while it is unknown. Raises DeviceError."""

    def configure(self, settings: CameraSettings) -> None:
        """Apply, or expect, these settings. Raises DeviceError."""

    def expose(self) -> ExposedFile:
        """Take one photograph and return its RAW file, complete, decodable and hashed. Raises DeviceError."""


class Imu(Device, Protocol):
    """Acceleration and rotation rate, streamed."""

    def start(self, rate_hz: float) -> None:
        """Stream at this rate. Raises DeviceError."""

    def stop(self) -> None:
        """Stream no more. Raises DeviceError."""

    def read_block(self, duration_s: float) -> ImuBlock:
        """Samples since the last block and during the next `duration_s`. Raises DeviceError."""


class Rangefinder(Device, Protocol):
    """A laser distance meter."""

    def measure(self) -> Distance:
        """One reading. Raises DeviceError."""

    def laser(self, on: bool) -> None:
        """Switch the laser spot, for aiming. Raises DeviceError."""


class Light(Device, Protocol):
    """A panel that illuminates the chart."""

    def set_level(self, level: float) -> None:
        """Set `level` in [0, 1] of full intensity. Raises DeviceError."""

    def level(self) -> float:
        """The level last set; after an order that failed, the brighter one."""

    def flicker(self, exposure_s: float) -> Caveat | None:
        """The caveat about exposures that are too short for its modulation."""


class Probe(Device, Protocol):
    """An instrument that measures quantities of the room or of the light."""

    def read(self) -> Mapping[str, ProbeReading]:
        """Its quantities now, each in its unit of `PROBE_UNITS`. Raises DeviceError, NoReading if it cannot measure."""


class Shaker(Device, Protocol):
    """A device that moves the camera along a given path during an exposure."""

    def strokes(self) -> Mapping[str, float]:
        """Amplitude of each axis from rest, in both directions."""

    def start(self, path: ShakePath) -> ShakePath:
        """Play this path until `stop`; returns the path actually commanded. Raises DeviceError."""

    def began_s(self) -> float:
        """When the first point was output, by the same clock synchronisation as the last shot."""

    def stop(self) -> None:
        """Return to rest at the end of the round. Raises DeviceError."""


class Parser(Protocol[E_co]):
    """Bytes to events without side effects: any split of the stream gives the same events, garbage never raises."""

    def feed(self, data: bytes) -> Sequence[E_co]:
        """The events completed by these bytes."""


class Line(Protocol):
    """The way to a device: a port, a server, a controller or a box with several devices."""

    @property
    def address(self) -> str:
        """The port or URL."""

    @property
    def is_open(self) -> bool:
        """Whether the port is owned and has not been lost."""

    def close(self) -> None:
        """Release the port and end the reader."""


class Transport(Line, Protocol[E_co]):
    """A line to a device: requests under a lock and a deadline, and a path past both for emergencies."""

    def open(self, listen: Callable[[E_co, float], None]) -> None:
        """Own the port; `listen(event, host_s)` is called for every event. Raises LineLost."""

    def request(
        self, data: bytes, answer: Callable[[E_co], T | None], timeout_s: float, tries: int = 1,
        allowed: Callable[[], None] = ...,
    ) -> T:  # fmt: skip
        """Write and wait until `answer(event)` is not None, up to `tries` times. Raises NoAnswer, LineLost.

        `allowed` raises why the order may not be given: it is called when nothing can intervene any more.
        """

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a state recorded by the listener. Raises LineLost, or the interruption."""

    def write(self, data: bytes, *, noted: bool = True, within_s: float = ...) -> None:
        """Write without waiting for a reply, a request or a lock; recorded in the transcript if `noted`.

        Raises LineLost, NoAnswer if `within_s` was not enough.
        """

    def preempt(self, data: bytes, error: Exception) -> None:
        """Drop unsent bytes, write without waiting for any lock, and end all waits with `error`; never raises."""

    def set_lines(self, **lines: bool) -> None:
        """Set modem lines: rts=, dtr=. Raises LineLost."""
