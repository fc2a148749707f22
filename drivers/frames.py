"""RAW files of a body: which names count, their exposure metadata, and its comparison with the request."""

import hashlib
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from drivers.errors import Clock, EmergencyStopped, FrameWrong, Rejected, SystemClock
from drivers.interfaces import CameraSettings, ExposedFile, FrameFormat
from drivers.options import option

TIFF_LIKE = frozenset((".3fr", ".arw", ".cr2", ".dng", ".erf", ".iiq", ".kdc", ".nef", ".nrw", ".pef", ".srw"))
OTHERS = frozenset((".cr3", ".crw", ".dcr", ".mef", ".mos", ".mrw", ".orf", ".raf", ".raw", ".rw2", ".x3f"))
RAW_SUFFIXES = TIFF_LIKE | OTHERS
THIRD_STOP = 2 ** (1 / 3) - 1  # bodies round their settings to thirds of a stop


@dataclass(frozen=True)
class ExposureMetadata:
    """Exposure metadata of a file, and the format of its frame; None where it is absent."""

    exposure_s: float | None = None
    iso: int | None = None
    f_number: float | None = None
    sensor: FrameFormat | None = None


# Decodes a RAW file and returns its metadata; any exception means that the file is incomplete or damaged.
Inspect = Callable[[Path], ExposureMetadata]


SensorText = Annotated[
    str,
    option(
        '"6000x4000 RGGB 14"', "size, colours of the 2 x 2 tile or grey, and bits in quotes",
        pattern=r"^\d{1,5}x\d{1,5} (RGGB|BGGR|GRBG|GBRG|grey) ([89]|1[0-6])\Z",
    ),
]  # fmt: skip


def sensor_format(text: str | None) -> FrameFormat | None:
    """The format written as "6000x4000 RGGB 14"."""
    if text is None:
        return None
    size, colours, bits = text.split()
    columns, rows = map(int, size.split("x"))
    return FrameFormat(columns, rows, None if colours == "grey" else colours, 2 ** int(bits) - 1)


class KnownSensor:
    """The sensor format of a body whose files come into a folder: as configured, or that of its newest file."""

    def __init__(self, folder: Path, inspect: Inspect, configured: FrameFormat | None) -> None:
        self._folder, self._inspect, self._format = folder, inspect, configured

    def read(self) -> FrameFormat | None:
        """The format; None while there is no file that decodes."""
        if self._format is None and self._folder.is_dir():
            with suppress(Exception):  # a file is renamed, or incomplete, on which decoders raise any exception
                files = sorted(filter(is_raw, self._folder.iterdir()), key=lambda path: path.stat().st_mtime_ns)
                self._format = self._inspect(files[-1]).sensor
        return self._format


def is_raw(path: Path) -> bool:
    """Whether this is the name of a RAW file that is neither temporary nor hidden."""
    return path.suffix.lower() in RAW_SUFFIXES and not path.name.startswith((".", "~"))


def sha256_of(path: Path) -> str:
    """SHA-256 of the file, in hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_settings(path: Path, facts: ExposureMetadata, wanted: CameraSettings) -> None:
    """Raises FrameWrong if the file's settings differ from the requested ones by more than a third of a stop."""
    for unit, target, actual in (
        (" s", wanted.exposure_s, facts.exposure_s),
        (" ISO", wanted.iso, facts.iso),
        ("", wanted.f_number, facts.f_number),
    ):
        if target is not None and actual is not None and not 1 / (1 + THIRD_STOP) <= actual / target <= 1 + THIRD_STOP:
            raise FrameWrong(
                f"{path.name} was taken at {actual:g}{unit} instead of {target:g}{unit}", "set the body, repeat"
            )


class FrameCamera(ABC):
    """Common part of cameras that wait for their frames, without motion: settings, one exposure at a time, stops."""

    def __init__(self, clock: Clock | None = None, settings: CameraSettings | None = None) -> None:
        self.clock = clock or SystemClock()
        self.settings = settings or CameraSettings()
        self._exposing, self._halted = threading.Lock(), False

    @property
    @abstractmethod
    def address(self) -> str: ...

    @abstractmethod
    def _expose(self) -> ExposedFile: ...

    def expose(self) -> ExposedFile:
        """Take one photograph: complete, decodable and hashed. Raises DeviceError; a second exposure is refused."""
        if not self._exposing.acquire(blocking=False):
            raise Rejected(f"{self.address} is already exposing", "wait for the frame")
        self._halted = False
        try:
            return self._expose()
        finally:
            self._exposing.release()

    def _check_stops(self) -> None:
        """Raises EmergencyStopped if a stop came since the exposure began."""
        if self._halted:
            raise EmergencyStopped(f"emergency stop at {self.address}", "make it safe, then expose again")

    def emergency_stop(self) -> None:
        """Nothing moves: stop waiting for a frame."""
        self._halted = True
