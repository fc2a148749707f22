"""A camera of a Raspberry Pi through libcamera's program `rpicam-still`, which writes the sensor's numbers as a DNG.

The program is started for each photograph; exposure and gain are fixed, so that it photographs at once.
"""

import re
import shutil
import subprocess
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from drivers.dng import DngFolder, OpticsMetadata
from drivers.errors import BadConfiguration, Clock, FrameMissing, LineLost, NoAnswer, Rejected
from drivers.frames import FrameCamera
from drivers.interfaces import CameraSettings, Condition, ExposedFile, FrameFormat, Identity
from drivers.making import DriverOptions, MakerContext
from drivers.options import Count, FolderName, option, positive, text
from drivers.wire.connection import line_condition, not_connected

PROGRAMS = ("rpicam-still", "libcamera-still")  # its name, and that of versions before 2023
LISTED_S = 20.0  # time limit of short requests to the program
POLL_S = 0.02
ISO_PER_GAIN = 100
CAMERA = re.compile(r"^(\d+) : (\S+) \[(\d+)x(\d+)[^\]]*\] \((.*)\)$", re.MULTILINE)
MODE = re.compile(r"'(?:S([RGB]{4})|R)(\d+)[^']*' :")
"""A raw mode of a camera: colours of its tile, none of a monochrome sensor, and bits."""
SIZE = re.compile(r"(\d+)x(\d+) \[")


@dataclass(frozen=True)
class RpicamSettings:
    """Settings of every photograph.

    exposure_s : exposure time until another is configured
    gain : analogue gain until an ISO is configured, which is 100 times the gain
    bits : of the raw mode; None takes the deepest one
    patience_s : time limit of a photograph in addition to three times its exposure: the sensor starts first
    """

    exposure_s: Annotated[float, positive("0.01")] = 0.01
    gain: Annotated[float, option("1.0", least=1)] = 1.0
    bits: Annotated[int, option("12", least=8, most=16)] | None = None
    patience_s: Annotated[float, positive("20")] = 20.0


class RpicamCamera(FrameCamera):
    """A Camera on `rpicam-still`; `number` counts the cameras from 0, `program` is its name or path, "" the usual."""

    def __init__(
        self, frames: DngFolder, number: int = 0, settings: RpicamSettings | None = None, *, program: str = "",
        clock: Clock | None = None,
    ) -> None:  # fmt: skip
        self._wanted = settings or RpicamSettings()
        super().__init__(clock, CameraSettings(self._wanted.exposure_s, round(ISO_PER_GAIN * self._wanted.gain)))
        self._frames, self._number, self._program = frames, number, program
        self._path = ""
        self._sensor: FrameFormat | None = None
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        return f"camera {self._number} of {self._program or PROGRAMS[0]}"

    def connect(self) -> Identity:
        """Find the program and the camera, and read its format. Raises DeviceError."""
        self.close()
        self._frames.check()
        names = (self._program,) if self._program else PROGRAMS
        path = next(filter(None, map(shutil.which, names)), None)
        if path is None:
            raise BadConfiguration(f"there is no program {' or '.join(names)}", "install it: apt install rpicam-apps")
        listed = self._ask(path, "--list-cameras")
        cameras = {int(match[1]): match for match in CAMERA.finditer(listed)}
        if self._number not in cameras:
            there = ", ".join(f"{number} ({match[2]})" for number, match in cameras.items()) or "none"
            raise LineLost(f"there is no camera {self._number}: {path} lists {there}", "check its ribbon cable")
        match = cameras[self._number]
        end = cameras[self._number + 1].start() if self._number + 1 in cameras else len(listed)
        self._sensor = self._deepest(listed[match.start() : end])
        self._path = path
        version = self._ask(path, "--version").partition("\n")[0].rpartition(":")[2].strip()
        return Identity(f"Raspberry Pi {match[2]}", version, match[5], self.address)

    def _ask(self, path: str, *words: str) -> str:
        """The answer of the program to a short request. Raises NoAnswer, LineLost."""
        try:
            done = subprocess.run([path, *words], capture_output=True, text=True, timeout=LISTED_S, check=False)
        except subprocess.TimeoutExpired as error:
            raise NoAnswer(f"{path} did not answer within {LISTED_S:g} s", "restart the computer") from error
        except OSError as error:
            raise LineLost(f"{path} cannot be run: {error.strerror}", "install it: apt install rpicam-apps") from error
        if done.returncode:
            raise _failure(path, done.stderr)
        return done.stdout

    def _deepest(self, entry: str) -> FrameFormat:
        """The raw mode with the configured bits, or the most, at its largest size. Raises BadConfiguration."""
        marks = list(MODE.finditer(entry))
        modes = []
        for mark, after in zip(marks, [*marks[1:], None], strict=True):
            sizes = SIZE.findall(entry[mark.end() : after.start() if after else len(entry)])
            columns, rows = max(((int(x), int(y)) for x, y in sizes), key=lambda size: size[0] * size[1])
            modes.append(FrameFormat(columns, rows, mark[1], 2 ** int(mark[2]) - 1, self._frames.optics.pixel_pitch_um))
        usable = [mode for mode in modes if self._wanted.bits in (None, mode.white.bit_length())]
        if not usable:
            offered = ", ".join(f"{mode.white.bit_length()}" for mode in modes) or "no raw mode"
            reason = f"{self.address} has no raw mode of {self._wanted.bits} bits: it offers {offered}"
            raise BadConfiguration(reason, "write bits that it offers, or omit them")
        return max(usable, key=lambda mode: (mode.columns * mode.rows, mode.white))

    def close(self) -> None:
        """Forget the camera: the program runs during a photograph only."""
        self._sensor = None

    def condition(self) -> Condition:
        return line_condition(self._sensor is not None)

    def sensor(self) -> FrameFormat:
        """The raw mode in which it photographs. Raises LineLost."""
        if self._sensor is None:
            raise not_connected(self.address)
        return self._sensor

    def configure(self, settings: CameraSettings) -> None:
        """Use this exposure time and ISO from now on."""
        if settings.iso is not None and settings.iso < ISO_PER_GAIN:
            raise Rejected(f"{self.address} has no ISO below {ISO_PER_GAIN}; got {settings.iso}", "choose a higher one")
        exposure_s = self.settings.exposure_s if settings.exposure_s is None else settings.exposure_s
        iso = self.settings.iso if settings.iso is None else settings.iso
        self.settings = CameraSettings(exposure_s, iso, settings.f_number)

    def _expose(self) -> ExposedFile:
        requested_s = self.clock.now_s()
        with tempfile.TemporaryDirectory(dir=self._frames.path, prefix=".rpicam-") as folder:
            picture = Path(folder, "frame.jpg")
            self._run(self._command(picture))
            file = picture.with_suffix(".dng")
            if not file.is_file():
                raise FrameMissing(f"{self.address} wrote no DNG", "update rpicam-apps")
            return self._frames.adopt(file, self.settings, requested_s)

    def _command(self, picture: Path) -> list[str]:
        sensor = self.sensor()
        microseconds = round(1e6 * float(self.settings.exposure_s or 0.0))
        gain = float(self.settings.iso or ISO_PER_GAIN) / ISO_PER_GAIN
        mode = f"{sensor.columns}:{sensor.rows}:{sensor.white.bit_length()}"
        return [
            self._path, "--camera", str(self._number), "--nopreview", "--immediate", "--raw", "--mode", mode,
            "--shutter", str(microseconds), "--gain", f"{gain:g}", "--awbgains", "1,1", "--denoise", "off",
            "--output", str(picture),
        ]  # fmt: skip

    def _run(self, command: list[str]) -> None:
        """Run the program to its end. Raises FrameMissing, LineLost, EmergencyStopped."""
        limit_s = 3 * float(self.settings.exposure_s or 0.0) + self._wanted.patience_s
        deadline_s = self.clock.now_s() + limit_s
        with tempfile.TemporaryFile() as log_file:
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log_file)
            self._process = process
            try:
                while (code := process.poll()) is None:
                    self._check_stops()
                    if self.clock.now_s() > deadline_s:
                        raise FrameMissing(f"{self.address} took no photograph within {limit_s:g} s", "check its cable")
                    self.clock.sleep(POLL_S)
            finally:
                self._process = None
                if process.poll() is None:
                    process.kill()
                    process.wait()
            self._check_stops()
            if code:
                log_file.seek(0)
                raise _failure(command[0], log_file.read().decode("utf-8", "replace"))

    def emergency_stop(self) -> None:
        """End the program, and with it the exposure."""
        super().emergency_stop()
        process = self._process
        if process is not None:
            with suppress(OSError):
                process.kill()


def _failure(path: str, log: str) -> LineLost:
    """The error for a program that failed, with its own words."""
    lines = [line for line in log.splitlines() if "ERROR" in line] or log.splitlines() or ["no reason given"]
    words = lines[-1].replace("ERROR:", "").strip(" *")
    return LineLost(f"{path} failed: {words}", "close other programs that use the camera, and check its cable")


@dataclass(frozen=True, kw_only=True)
class RpicamOptions(RpicamSettings, DriverOptions):
    """Options of driver "rpicam"."""

    folder: FolderName
    camera: Count = 0
    program: Annotated[str, text('"rpicam-still"', "the name or path of a program in quotes")] = ""

    pixel_pitch_um: Annotated[float, positive("1.55")] | None = None

    def make(self, parts: MakerContext) -> RpicamCamera:
        optics = OpticsMetadata(pixel_pitch_um=self.pixel_pitch_um)
        frames = DngFolder(parts.folder / self.folder, parts.inspect, optics, clock=parts.clock)
        return RpicamCamera(frames, self.camera, self, program=self.program, clock=parts.clock)
