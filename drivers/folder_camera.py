"""Any tethered body whose software saves RAW files to a folder, fired by a shutter box.

A file is accepted when its size and time are stable, it decodes, and it did not change while it was hashed. A file
that does not decode yet is examined again, as it may still grow.
"""

from contextlib import suppress
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import Annotated

from drivers.errors import Clock, DeviceError, EmergencyStopped, FrameMissing, FrameWrong, LineLost, SystemClock
from drivers.frames import (
    ExposureMetadata,
    Inspect,
    KnownSensor,
    SensorText,
    check_settings,
    is_raw,
    sensor_format,
    sha256_of,
)
from drivers.interfaces import CameraSettings, Condition, ExposedFile, FrameFormat, Identity, Shutter
from drivers.making import DriverOptions, MakerContext
from drivers.options import SHUTTER, FolderName, PollInterval, Seconds, device, positive

Stamp = tuple[int, int]  # size, modification time in ns


@dataclass(frozen=True)
class Tether:
    """Properties of the body and its software: contact time, time without change before a file is accepted, time limit
    after the exposure.

    `bulb`: the contact is held for the whole exposure.
    """

    pulse_s: Annotated[float, positive("0.1")] = 0.1
    focus_s: Seconds = 0.0
    bulb: bool = False
    rest_s: Seconds = 0.5
    patience_s: Annotated[float, positive("20")] = 20.0
    poll_s: PollInterval = 0.1


@dataclass
class Candidate:
    """A file that may become the frame: its size and time, since when, and why it is not accepted yet."""

    stamp: Stamp
    since_s: float
    why: str = "it still grows"


class FolderCamera:
    """A Camera whose frames come through a folder."""

    def __init__(
        self, folder: Path, shutter: Shutter, inspect: Inspect, *, tether: Tether | None = None,
        sensor: FrameFormat | None = None, clock: Clock | None = None,
    ) -> None:  # fmt: skip
        self.clock = clock or SystemClock()
        self.tether = tether or Tether()
        self._sensor = KnownSensor(folder, inspect, sensor)
        self.settings = CameraSettings()
        self._folder = folder
        self._shutter = shutter
        self._inspect = inspect
        self._known: dict[Path, Stamp] = {}
        self._hashes: set[str] = set()
        self._strays = 0
        self._stray_until_s = -float("inf")
        self._connected = False
        self._stopped: EmergencyStopped | None = None

    @property
    def address(self) -> str:
        return str(self._folder)

    def connect(self) -> Identity:
        """List the files already in the folder; the shutter is connected by its owner. Raises LineLost."""
        if not self._folder.is_dir():
            raise LineLost(f"there is no folder {self._folder}", "create it, and let the tethering software save there")
        self._known = self._look()
        self._connected = True
        return Identity("folder camera", "", "", self.address)

    def close(self) -> None:
        self._connected = False

    def condition(self) -> Condition:
        if not self._connected:
            return Condition("not connected", False, "connect it")
        if not self._folder.is_dir():
            return Condition("the folder is gone", False, "create it again")
        count = len(self._hashes)
        return Condition("1 frame" if count == 1 else f"{count} frames")

    def sensor(self) -> FrameFormat | None:
        """The configured format, or that of the newest file in the folder."""
        return self._sensor.read()

    def configure(self, settings: CameraSettings) -> None:
        """Expect these settings in the files; the body itself is set by hand."""
        self.settings = settings

    def expose(self) -> ExposedFile:
        """Fire once and return the one RAW file of that exposure. Raises FrameMissing, FrameWrong."""
        self._stopped = None
        # wait until the frames of earlier, failed exposures came: each could be taken for the next one's
        candidates: dict[Path, Candidate] = {}
        while self._strays > 0 and self.clock.now_s() < self._stray_until_s:
            self._pause()
            self._track(candidates)
            self._strays -= sum(self._accept(path, candidates) is not None for path in list(candidates))
        self._strays = 0
        self._known |= self._look()
        requested_s = self.clock.now_s()
        exposure_s = self.settings.exposure_s or 0.0
        pulse_s = exposure_s if self.tether.bulb and exposure_s else self.tether.pulse_s
        self._check_stops()  # the folder's list may take long
        try:
            shutter = self._shutter.fire(pulse_s, self.tether.focus_s)
            path, facts, digest = self._await_frame(exposure_s)
        except DeviceError:
            self._strays += 1
            self._stray_until_s = self.clock.now_s() + exposure_s + self.tether.patience_s
            raise
        companions = tuple(
            sorted(p for p in self._folder.glob(f"{escape(path.stem)}.*") if p != path and not is_raw(p))
        )
        received_s, size = self.clock.now_s(), self._known[path][0]
        exposure = ExposedFile(path, digest, size, self.settings, requested_s, received_s, shutter, companions)
        check_settings(path, facts, self.settings)
        return exposure

    def _pause(self) -> None:
        """Wait until the next poll of the folder. Raises an emergency stop that came meanwhile."""
        self.clock.sleep(self.tether.poll_s)
        self._check_stops()

    def _check_stops(self) -> None:
        """Raises an emergency stop since the exposure began."""
        if self._stopped is not None:
            raise self._stopped

    def _look(self) -> dict[Path, Stamp]:
        """Every RAW file with its size and time; a file that vanishes meanwhile was renamed. Raises LineLost."""
        listed = {}
        try:
            for path in filter(is_raw, self._folder.iterdir()):
                with suppress(FileNotFoundError):
                    stat = path.stat()
                    listed[path] = (stat.st_size, stat.st_mtime_ns)
        except OSError as error:
            reason = f"the folder {self._folder} cannot be read: {error.strerror}"
            raise LineLost(reason, "bring it back, then repeat") from error
        return listed

    def _await_frame(self, exposure_s: float) -> tuple[Path, ExposureMetadata, str]:
        deadline_s = self.clock.now_s() + exposure_s + self.tether.patience_s
        candidates: dict[Path, Candidate] = {}
        while self.clock.now_s() < deadline_s:
            self._pause()
            self._track(candidates)
            accepted = [frame for path in list(candidates) if (frame := self._accept(path, candidates)) is not None]
            if len(accepted) > 1:
                names = ", ".join(path.name for path, _, _ in accepted)
                raise FrameWrong(f"one exposure gave {len(accepted)} RAW files ({names})", "let only the body fire")
            if accepted:
                return accepted[0]
        reasons = "; ".join(f"{path.name}: {candidate.why}" for path, candidate in candidates.items())
        raise FrameMissing(
            f"no complete RAW file in {self._folder} within {self.tether.patience_s:g} s ({reasons or 'none came'})",
            "check body, battery, card and tethering software, then repeat",
        )

    def _track(self, candidates: dict[Path, Candidate]) -> None:
        now_s, listed = self.clock.now_s(), self._look()
        for path in [path for path in candidates if path not in listed]:
            del candidates[path]
        for path, stamp in listed.items():
            if self._known.get(path) == stamp:
                continue
            if path not in candidates or candidates[path].stamp != stamp:
                candidates[path] = Candidate(stamp, now_s)

    def _accept(self, path: Path, candidates: dict[Path, Candidate]) -> tuple[Path, ExposureMetadata, str] | None:
        """The file, if it is stable, decodes, is new, and did not change while it was read."""
        candidate = candidates[path]
        if self.clock.now_s() - candidate.since_s < self.tether.rest_s:
            return None
        try:
            facts = self._inspect(path)
            digest = sha256_of(path)
        except Exception as error:  # decoders raise any exception on an incomplete file
            candidate.why = f"it does not decode ({error})"
            return None
        if self._look().get(path) != candidate.stamp:
            return None
        self._known[path] = candidate.stamp
        if digest in self._hashes:
            del candidates[path]  # the same photograph under another name
            return None
        self._hashes.add(digest)
        return path, facts, digest

    def emergency_stop(self) -> None:
        """Open the contacts and stop waiting for a frame; one that still comes stays in the folder."""
        self._stopped = EmergencyStopped(f"emergency stop at {self.address}", "expose again")
        self._shutter.emergency_stop()


@dataclass(frozen=True, kw_only=True)
class FolderOptions(Tether, DriverOptions):
    """Options of driver "folder"."""

    folder: FolderName
    shutter: Annotated[str, device(SHUTTER, '"shutter"')]
    sensor: SensorText | None = None

    def make(self, parts: MakerContext) -> FolderCamera:
        box, place = parts.other(self.shutter), parts.folder / self.folder
        sensor = sensor_format(self.sensor)
        return FolderCamera(place, box, parts.inspect, tether=self, sensor=sensor, clock=parts.clock)
