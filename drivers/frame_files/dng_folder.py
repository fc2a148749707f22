"""Frames of a camera that gives pixels and no file: written as DNGs, numbered, whole or not at all, read again, hashed.

So everything downstream is one way, whichever camera it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from drivers.clock import Clock, SystemClock
from drivers.errors import FrameWrong, LineLost
from drivers.frame_files.dng import Mosaic, Shot, write_dng
from drivers.frames import Inspect, check_settings, sha256_of
from drivers.interfaces import CameraSettings, ExposedFile, ShutterTimes


@dataclass(frozen=True)
class Optics:
    """What such a camera cannot know of itself; it is noted in its files as it was told.

    Attributes
    ----------
    f_number, focal_length_mm, lens : of the lens on it; "" where it is not named
    pixel_pitch_um : between pixels of the sensor
    black : level of every position of the mosaic, in digital numbers
    """

    f_number: float | None = None
    focal_length_mm: float | None = None
    lens: str = ""
    pixel_pitch_um: float | None = None
    black: float = 0.0


@dataclass(frozen=True)
class Frame:
    """What a camera read out: (rows, columns) of digital numbers, the colours of its 2 x 2 tile, its highest number.

    `cfa` is None of a monochrome sensor; `comment` says what has no tag of its own.
    """

    mosaic: Mosaic
    cfa: str | None
    white: int
    exposure_s: float
    comment: str = ""


@dataclass(frozen=True)
class Body:
    """Which camera it is, as its files tell."""

    make: str
    model: str
    serial: str = ""


class DngFolder:
    """The folder that a camera's frames go to."""

    def __init__(
        self, folder: Path, inspect: Inspect, optics: Optics | None = None, *, clock: Clock | None = None
    ) -> None:
        self.path = folder
        self._inspect, self._optics, self._clock = inspect, optics or Optics(), clock or SystemClock()

    def check(self) -> None:
        """Raises LineLost where the folder is not there."""
        if not self.path.is_dir():
            raise LineLost(f"there is no folder {self.path}", "create it")

    def _next(self) -> Path:
        """The name after the last one that lies there."""
        numbers = (path.stem.removeprefix("IMG_") for path in self.path.glob("IMG_*"))
        last = max((int(number) for number in numbers if number.isdecimal()), default=0)
        return self.path / f"IMG_{last + 1:04d}.DNG"

    def keep(
        self, frame: Frame, body: Body, wanted: CameraSettings, requested_s: float, shutter: ShutterTimes | None = None
    ) -> ExposedFile:
        """The frame as a file that reads back, as it was wanted. Raises FrameWrong, LineLost."""
        self.check()
        path = self._write(frame, body)
        try:
            facts = self._inspect(path)
        except Exception as error:  # readers raise what they like
            raise FrameWrong(f"{path.name} does not read back: {error}", "check the disk, then repeat") from error
        check_settings(path, facts, wanted)
        settings = CameraSettings(frame.exposure_s, None, self._optics.f_number)
        size, received_s = path.stat().st_size, self._clock.now_s()
        return ExposedFile(path, sha256_of(path), size, settings, requested_s, received_s, shutter)

    def _write(self, frame: Frame, body: Body) -> Path:
        optics, path = self._optics, self._next()
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
            raise LineLost(
                f"{path} cannot be written: {error.strerror}", "make room, or name another folder"
            ) from error
        return path
