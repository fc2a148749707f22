"""Frames of a camera that delivers pixels and no file: written atomically as numbered DNGs, read back, hashed.

Later stages thus see RAW files, whichever camera took them.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated

import numpy as np

from drivers.clock import Clock, SystemClock
from drivers.errors import FrameWrong, LineLost
from drivers.frame_files.dng import Mosaic, Shot, write_dng
from drivers.frames import Inspect, check_settings, sha256_of
from drivers.interfaces import CameraSettings, ExposedFile, ShutterTimes
from drivers.options import option, positive, text


@dataclass(frozen=True)
class OpticsMetadata:
    """Data that such a camera cannot know; written to its files as configured.

    Attributes
    ----------
    f_number, focal_length_mm, lens : of the lens; "" if it has no name
    pixel_pitch_um : pixel pitch of the sensor
    black : black level of each position of the mosaic, in digital numbers
    """

    f_number: Annotated[float, positive("4.0")] | None = None
    focal_length_mm: Annotated[float, positive("25")] | None = None
    lens: Annotated[str, text('"Lens 25 mm"')] = ""
    pixel_pitch_um: Annotated[float, positive("3.45")] | None = None
    black: Annotated[float, option("64", least=0)] = 0.0


@dataclass(frozen=True)
class Frame:
    """A frame read from a camera: (rows, columns) of digital numbers, colours of the 2 x 2 tile, largest number.

    `cfa` is None for a monochrome sensor; `comment` holds metadata without a tag.
    """

    mosaic: Mosaic
    cfa: str | None
    white: int
    exposure_s: float
    comment: str = ""


@dataclass(frozen=True)
class Body:
    """Identity of the camera, as written to its files."""

    make: str
    model: str
    serial: str = ""


class DngFolder:
    """The folder of a camera's frames."""

    def __init__(
        self, folder: Path, inspect: Inspect, optics: OpticsMetadata | None = None, *, clock: Clock | None = None
    ) -> None:
        self.path = folder
        self._inspect, self.optics, self._clock = inspect, optics or OpticsMetadata(), clock or SystemClock()

    def check(self) -> None:
        """Raises LineLost if the folder does not exist."""
        if not self.path.is_dir():
            raise LineLost(f"there is no folder {self.path}", "create it")

    def _next(self) -> Path:
        """The next file name in the numbering."""
        numbers = (path.stem.removeprefix("IMG_") for path in self.path.glob("IMG_*"))
        last = max((int(number) for number in numbers if number.isdecimal()), default=0)
        return self.path / f"IMG_{last + 1:04d}.DNG"

    def keep(
        self, frame: Frame, body: Body, wanted: CameraSettings, requested_s: float, shutter: ShutterTimes | None = None
    ) -> ExposedFile:
        """Write the frame and read it back. Raises FrameWrong if it differs from the request, LineLost."""
        self.check()
        settings = CameraSettings(frame.exposure_s, None, self.optics.f_number)
        return self._record(self._write(frame, body), wanted, settings, requested_s, shutter)

    def adopt(self, file: Path, wanted: CameraSettings, requested_s: float) -> ExposedFile:
        """Give a DNG of the camera the next name in the numbering, and read it. Raises FrameWrong, LineLost."""
        self.check()
        path = self._next()
        try:
            file.rename(path)
        except OSError as error:
            raise _unwritable(path, error) from error
        return self._record(path, wanted, None, requested_s, None)

    def _record(
        self,
        path: Path,
        wanted: CameraSettings,
        settings: CameraSettings | None,
        requested_s: float,
        shutter: ShutterTimes | None,
    ) -> ExposedFile:
        """Read a file back; without `settings` those in the file are the photograph's."""
        try:
            facts = self._inspect(path)
        except Exception as error:  # readers may raise anything
            raise FrameWrong(f"{path.name} does not read back: {error}", "check the disk, then repeat") from error
        check_settings(path, facts, wanted)
        settings = settings or CameraSettings(facts.exposure_s, facts.iso, facts.f_number)
        size, received_s = path.stat().st_size, self._clock.now_s()
        return ExposedFile(path, sha256_of(path), size, settings, requested_s, received_s, shutter)

    def _write(self, frame: Frame, body: Body) -> Path:
        optics, path = self.optics, self._next()
        shot = Shot(
            frame.exposure_s, optics.f_number, None, optics.focal_length_mm, optics.pixel_pitch_um,
            captured_at=datetime.now(), make=body.make, model=body.model, serial=body.serial,
            lens=optics.lens, lens_serial="", comment=frame.comment,
        )  # fmt: skip
        part = path.with_suffix(".part")
        mosaic = np.ascontiguousarray(frame.mosaic, dtype=np.uint16)
        try:
            write_dng(part, mosaic, shot, cfa=frame.cfa, black=(optics.black,) * 4, white=frame.white)
            part.rename(path)
        except OSError as error:
            raise _unwritable(path, error) from error
        return path


def _unwritable(path: Path, error: OSError) -> LineLost:
    return LineLost(f"{path} cannot be written: {error.strerror}", "make room, or name another folder")
