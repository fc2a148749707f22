"""A Micro-Manager camera: its snapped image, written as a DNG with its exposure."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from drivers.dng import Body, DngFolder, Frame
from drivers.errors import BadConfiguration, Clock, FrameWrong, LineLost, MoveFailed, Rejected, SystemClock
from drivers.frames import FrameCamera
from drivers.interfaces import CameraSettings, Condition, ExposedFile, FrameFormat, Identity, ShutterTimes
from drivers.making import DriverOptions, FrameOptions, MakerContext
from drivers.options import SHUTTER as PROVIDES_SHUTTER
from drivers.options import option, text
from drivers.wire.connection import closed_after_errors, line_condition, not_connected


class Core:
    """The core with the devices of a configuration file; `adapters` is the folder of the device adapters.

    Calls may come from any thread: the core serialises them per adapter. A sequence of calls, such as selecting a
    camera and reading it, holds `in_a_row`.
    """

    def __init__(self, config: Path, adapters: Path | None = None) -> None:
        self.config, self.adapters = config, adapters or config.parent
        self.in_a_row = threading.RLock()
        self._users: set[int] = set()
        self._core: Any = None

    def join(self, user: object) -> Any:
        """The core with all devices loaded. Raises BadConfiguration, LineLost."""
        with self.in_a_row:
            if self._core is None:
                self._core = self._load()
            self._users.add(id(user))
            return self._core

    def leave(self, user: object) -> None:
        """Unload all devices when the last user leaves."""
        with self.in_a_row:
            self._users.discard(id(user))
            if self._users or self._core is None:
                return
            core, self._core = self._core, None
            with suppress(RuntimeError):  # a device that is gone raises on unloading
                core.unloadAllDevices()

    def _load(self) -> Any:
        try:
            import pymmcore
        except ImportError as error:
            raise BadConfiguration(
                "pymmcore is not installed", "install it: pip install 'calibration-station[micromanager]'"
            ) from error
        if not self.config.is_file():
            raise BadConfiguration(f"{self.config} does not exist", "write it with Micro-Manager's hardware wizard")
        core = pymmcore.CMMCore()
        core.setDeviceAdapterSearchPaths([str(self.adapters)])
        try:
            core.loadSystemConfiguration(str(self.config))
        except (RuntimeError, OSError) as error:
            with suppress(RuntimeError):
                core.unloadAllDevices()
            raise LineLost(
                f"{self.config.name}: {adapter_message(error)}",
                f"switch the devices on; adapters are searched for in {self.adapters} ({core.getAPIVersionInfo()})",
            ) from error
        return core


@contextmanager
def translated_errors(address: str, remedy: str) -> Iterator[None]:
    """Context that converts the core's exceptions to Rejected."""
    try:
        yield
    except RuntimeError as error:
        raise Rejected(f"{address}: {adapter_message(error)}", remedy) from error


def adapter_message(error: Exception) -> str:
    """An adapter's error message on one line."""
    return " ".join(str(error).split())


def check_device(core: Any, label: str, kind: int, what: str, config: str) -> None:
    """Raises BadConfiguration unless the configuration has such a device; `kind` is Micro-Manager's type number."""
    labels = core.getLoadedDevices()
    good = [one for one in labels if int(core.getDeviceType(one)) == kind]
    if label not in good:
        state = "has another type" if label in labels else "is not in it"
        there = ", ".join(good) or "it has none"
        raise BadConfiguration(f"{config}: {label} {state}; a {what} is required", f"name one of its {what}s: {there}")


CAMERA, SHUTTER, STAGE, XY_STAGE = 2, 3, 5, 6  # Micro-Manager's device type numbers (MMDeviceConstants.h)


Label = Annotated[str, text('"Camera"', "a device's label in that configuration in quotes")]


@dataclass(frozen=True, kw_only=True)
class CoreOptions(DriverOptions):
    """A Micro-Manager configuration, whose devices share a core."""

    config: Annotated[str, text('"microscope.cfg"', "the name of a configuration file in quotes")]
    adapters: (
        Annotated[str, text('"/opt/micro-manager"', "the folder of Micro-Manager's adapters in quotes")] | None
    ) = None

    def core(self, parts: MakerContext) -> Core:
        """The core of the configuration file."""
        path = (parts.folder / self.config).resolve()
        adapters = None if self.adapters is None else parts.folder / self.adapters
        core: Core = parts.shared.setdefault(path, Core(path, adapters))
        return core


class CoreDevice(ABC):
    """A device, or several, of a configuration: `labels` with their type numbers and what they are called."""

    def __init__(self, core: Core, labels: Mapping[str, tuple[int, str]], clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self._shared, self._labels = core, labels
        self._label = next(iter(labels))
        self._core: Any = None

    @property
    def address(self) -> str:
        """The devices' labels and their configuration."""
        return f"{', '.join(self._labels)} in {self._shared.config.name}"

    def connect(self) -> Identity:
        """Load the configuration and check that the devices exist. Raises DeviceError."""
        self.close()
        core = self._shared.join(self)
        with closed_after_errors(self):
            for label, (kind, what) in self._labels.items():
                check_device(core, label, kind, what, self._shared.config.name)
            self._prepare(core)
        self._core = core
        models = "; ".join(f"{core.getDeviceLibrary(one)} {core.getDeviceName(one)}" for one in self._labels)
        return Identity(f"Micro-Manager {models}", core.getVersionInfo(), "", self.address)

    @abstractmethod
    def _prepare(self, core: Any) -> None:
        """Set the devices up. Raises DeviceError."""

    def close(self) -> None:
        self._core = None
        self._shared.leave(self)

    def condition(self) -> Condition:
        return line_condition(self._core is not None)

    def _open(self) -> Any:
        if (core := self._core) is None:
            raise not_connected(self.address)
        return core


GAIN_ROUNDING = 0.01  # allowed relative deviation from the requested gain
REMEDY = "check its power and cable, then connect it again"


class MicroManagerCamera(CoreDevice, FrameCamera):
    """A Camera of a Micro-Manager configuration.

    cfa : colours of its tile, None for a monochrome sensor
    gain : in the adapter's own unit, None keeps the configuration's
    """

    def __init__(
        self, core: Core, device: str, frames: DngFolder, *, cfa: str | None = None, gain: float | None = None,
        clock: Clock | None = None,
    ) -> None:  # fmt: skip
        CoreDevice.__init__(self, core, {device: (CAMERA, "camera")})
        FrameCamera.__init__(self, clock)
        self._frames, self._cfa, self._gain = frames, cfa, gain

    def _prepare(self, core: Any) -> None:
        self._frames.check()
        if self._gain is not None:
            gain = self._gain
            remedy = "write a gain that its property Gain takes, or remove it"
            with translated_errors(self.address, remedy):
                core.setProperty(self._label, "Gain", f"{gain:g}")
                there = float(core.getProperty(self._label, "Gain"))
            if abs(there - gain) > GAIN_ROUNDING * abs(gain):
                raise Rejected(f"{self.address} is set to a gain of {there:g} instead of {gain:g}", remedy)

    def sensor(self) -> FrameFormat:
        """The current camera's region of interest. Raises DeviceError."""
        core = self._open()
        with self._shared.in_a_row, translated_errors(self.address, REMEDY):
            core.setCameraDevice(self._label)
            size, white = (int(core.getImageWidth()), int(core.getImageHeight())), 2 ** int(core.getImageBitDepth()) - 1
        return FrameFormat(*size, self._cfa, white, self._frames.optics.pixel_pitch_um)

    def configure(self, settings: CameraSettings) -> None:
        """Set the exposure time. Raises Rejected if the camera uses another one, or an ISO is requested."""
        core = self._open()
        if settings.iso is not None:
            raise Rejected(f"{self.address} has a gain and no ISO", "set its gain in Micro-Manager's configuration")
        if settings.exposure_s is not None:
            with translated_errors(self.address, "choose a time that the camera offers"):
                core.setExposure(self._label, 1000 * settings.exposure_s)
                there_s = core.getExposure(self._label) / 1000
            if abs(there_s / settings.exposure_s - 1) > 0.01:
                raise Rejected(
                    f"{self.address} exposes {there_s:g} s instead of {settings.exposure_s:g} s",
                    "choose a time that the camera offers",
                )
        self.settings = settings

    def _expose(self) -> ExposedFile:
        """One interrupted by an emergency stop is kept in the folder."""
        core, requested_s = self._open(), self.clock.now_s()
        with self._shared.in_a_row, translated_errors(self.address, REMEDY):
            core.setCameraDevice(self._label)
            begun_s = self.clock.now_s()
            core.snapImage()
            times = ShutterTimes(begun_s, self.clock.now_s())
            exposure_s = core.getExposure(self._label) / 1000
            frame = Frame(self._plane(core), self._cfa, 2 ** int(core.getImageBitDepth()) - 1, exposure_s)
        body = Body("Micro-Manager", f"{core.getDeviceLibrary(self._label)} {core.getDeviceName(self._label)}")
        saved = self._frames.keep(frame, body, self.settings, requested_s, times)
        self._check_stops()
        return saved

    def _plane(self, core: Any) -> np.ndarray[Any, np.dtype[np.uint16]]:
        """The snapped image. Raises FrameWrong unless it is one plane of at most 16 bits."""
        parts, octets = int(core.getNumberOfComponents()), int(core.getBytesPerPixel())
        if parts != 1 or octets > 2:
            raise FrameWrong(
                f"{self.address} gives {parts} colours in {octets} bytes a pixel; one of at most 2 is required",
                "set its pixel type to a grey or raw one of 8 to 16 bits",
            )
        return np.asarray(core.getImage()).astype(np.uint16)


@dataclass(frozen=True, kw_only=True)
class MicroManagerCameraOptions(FrameOptions, CoreOptions):
    """Options of driver "micromanager_camera"."""

    device: Label
    gain: Annotated[float, option("0")] | None = None
    mosaic: Literal["none", "RGGB", "BGGR", "GRBG", "GBRG"] = "none"

    def make(self, parts: MakerContext) -> MicroManagerCamera:
        cfa = None if self.mosaic == "none" else self.mosaic
        return MicroManagerCamera(
            self.core(parts), self.device, self.frames(parts), cfa=cfa, gain=self.gain, clock=parts.clock
        )


# --- A Micro-Manager shutter: in the light path, or on the trigger line of a camera ---


class MicroManagerShutter(CoreDevice):
    """A Shutter of a Micro-Manager configuration; its times are the host's."""

    def __init__(self, core: Core, device: str, *, clock: Clock | None = None) -> None:
        super().__init__(core, {device: (SHUTTER, "shutter")}, clock)
        self._end = threading.Condition()
        self._aborts = 0

    def _prepare(self, core: Any) -> None:
        self._set(core, False)

    def focus(self, pressed: bool) -> None:
        """Not supported: there is no focus contact. Raises Rejected."""
        raise Rejected(f"{self.address} has no focus contact", "focus by hand, or use a STRIG/1 box")

    def fire(self, pulse_s: float, focus_s: float = 0.0) -> ShutterTimes:
        core, aborts = self._open(), self._aborts
        self.clock.sleep(focus_s)
        begun_s = self.clock.now_s()
        try:
            if self._aborts == aborts:
                self._set(core, True)
            with self._end:
                self.clock.wait(self._end, lambda: self._aborts != aborts, self.clock.now_s() + pulse_s)
        finally:
            self._set(core, False)
        if self._aborts != aborts:
            raise MoveFailed(f"the shot at {self.address} was cut short", "fire again")
        return ShutterTimes(begun_s, self.clock.now_s())

    def _set(self, core: Any, opened: bool) -> None:
        with translated_errors(self.address, "check its power and cable, then connect it again"):
            core.setShutterOpen(self._label, opened)

    def abort(self) -> None:
        self._aborts += 1
        with self._end:
            self._end.notify_all()
        if self._core is not None:
            self._set(self._core, False)

    def emergency_stop(self) -> None:
        self._aborts += 1
        if (core := self._core) is not None:
            with suppress(Exception):
                core.setShutterOpen(self._label, False)
        # a waiting shot wakes by itself at the end of its pulse at the latest; waiting for it here is not allowed
        if self._end.acquire(blocking=False):
            self._end.notify_all()
            self._end.release()


@dataclass(frozen=True, kw_only=True)
class MicroManagerShutterOptions(CoreOptions):
    """Options of driver "micromanager_shutter"."""

    provides: ClassVar[tuple[str, ...]] = (PROVIDES_SHUTTER,)
    device: Label

    def make(self, parts: MakerContext) -> MicroManagerShutter:
        return MicroManagerShutter(self.core(parts), self.device, clock=parts.clock)
