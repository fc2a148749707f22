"""A DNG file of a mosaic, as a camera writes it: uncompressed, with black levels, exposure and serial numbers.

Tags are those of TIFF 6, of TIFF/EP and EXIF 2.32, and of the DNG specification 1.4.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt

from drivers import tiff
from drivers.errors import Clock, FrameWrong, LineLost, SystemClock
from drivers.frames import Inspect, check_settings, sha256_of
from drivers.interfaces import CameraSettings, ExposedFile, ShutterTimes
from drivers.options import option, positive
from drivers.options import text as text_option
from drivers.tiff import UNDEFINED, Entry, byte, long, rational, short, text

Mosaic = npt.NDArray[np.uint16]


@dataclass(frozen=True)
class Shot:
    """Metadata of one exposure; what is None is not written to the file."""

    exposure_s: float = 0.02
    f_number: float | None = 5.6
    iso: int | None = 100
    focal_length_mm: float | None = 50.0
    pixel_pitch_um: float | None = None
    subject_distance_mm: float | None = None
    captured_at: datetime = datetime(2026, 1, 1, 12, 0, 0)
    make: str = "Calibration Station"
    model: str = "Simulated Bench"
    serial: str = "0001"
    lens: str = "Simulated 50 mm"
    lens_serial: str = "0001"
    comment: str = ""


def write_dng(
    path: Path, mosaic: Mosaic, shot: Shot, *, cfa: str | None, black: Sequence[float], white: int, bits: int = 16,
    orientation: int = 1,
) -> None:  # fmt: skip
    """Write a mosaic (rows, columns) to a DNG file.

    Raises ValueError if a number does not fit into `bits`.

    cfa : str or None, colours of the 2 x 2 tile, row by row; None writes a monochrome file
    black : (4,) black level of each position of the tile, row by row
    bits : int, width of a number in the file: 16 is fastest, 10, 12 and 14 pack them most significant bit first
    """
    if int(mosaic.max(initial=0)) >= 2**bits:
        raise ValueError(f"numbers up to {int(mosaic.max())} do not fit into {bits} bits; write 16")
    data = pack(mosaic, bits)
    # everything before the pixels, padded to a multiple of 16 bytes
    size = len(data)
    rows, columns = mosaic.shape
    tags = {
        254: long(0), 256: long(columns), 257: long(rows), 258: short(bits), 259: short(1),
        262: short(32803 if cfa else 34892), 271: text(shot.make), 272: text(shot.model), 274: short(orientation),
        277: short(1), 278: long(rows), 279: long(size), 284: short(1), 305: text("calibration-station"),
        306: text(shot.captured_at.strftime("%Y:%m:%d %H:%M:%S")),
        50706: byte(1, 4, 0, 0), 50707: byte(1, 1, 0, 0), 50708: text(f"{shot.make} {shot.model}"),
        50713: short(2, 2), 50714: rational(*black), 50717: long(white), 50735: text(shot.serial),
    }  # fmt: skip
    head = tiff.head(tags | _colour_tags(cfa), _exif_tags(shot), [size])
    with open(path, "wb") as file:
        file.write(head)
        file.write(data)


def pack(mosaic: Mosaic, bits: int) -> bytes:
    """Pack numbers of `bits` bits, most significant first, each row padded to a whole byte.

    Four numbers of 10, 12 or 14 bits are 5, 6 or 7 bytes, assembled in one 64-bit word.
    """
    if bits == 16:
        return mosaic.astype("<u2").tobytes()
    rows, columns = mosaic.shape
    padded = np.zeros((rows, -(-columns // 4) * 4), dtype=np.uint64)
    padded[:, :columns] = mosaic
    quads = padded.reshape(rows, -1, 4)
    word = quads[..., 0]
    for i in (1, 2, 3):
        word = (word << np.uint64(bits)) | quads[..., i]
    word <<= np.uint64(64 - 4 * bits)
    octets = word.astype(">u8").view(np.uint8).reshape(rows, -1, 8)[:, :, : bits // 2]
    return octets.reshape(rows, -1)[:, : -(-columns * bits // 8)].tobytes()


def _colour_tags(cfa: str | None) -> dict[int, Entry]:
    """The mosaic, and an identity-like colour matrix, as the filters are unknown."""
    if not cfa:
        return {}
    return {
        33421: short(2, 2), 33422: byte(*("RGB".index(colour) for colour in cfa)),
        50710: byte(0, 1, 2), 50711: short(1),
        50721: rational(1, 0, 0, 0, 1, 0, 0, 0, 1, signed=True),
        50728: rational(0.6, 1.0, 0.7), 50778: short(21),
    }  # fmt: skip


def _exif_tags(shot: Shot) -> dict[int, Entry]:
    date = shot.captured_at.strftime("%Y:%m:%d %H:%M:%S")
    tags = {
        33434: rational(shot.exposure_s), 36864: (UNDEFINED, 4, b"0232"), 36867: text(date), 36868: text(date),
        37377: rational(-math.log2(shot.exposure_s), signed=True),
        37521: text(f"{shot.captured_at.microsecond:06d}"), 42033: text(shot.serial),
    } | _lens_tags(shot)  # fmt: skip
    if shot.iso is not None:
        tags |= {34855: short(min(shot.iso, 65535)), 34864: short(2)}
    if shot.pixel_pitch_um is not None:
        per_cm = rational(10_000 / shot.pixel_pitch_um)
        tags |= {41486: per_cm, 41487: per_cm, 41488: short(3)}
    if shot.subject_distance_mm is not None:
        tags[37382] = rational(shot.subject_distance_mm / 1000)
    if shot.comment:
        comment = b"ASCII\0\0\0" + shot.comment.encode("ascii", "backslashreplace")
        tags[37510] = (UNDEFINED, len(comment), comment)
    return tags


def _lens_tags(shot: Shot) -> dict[int, Entry]:
    """Tags of the lens; its specification (42034) needs both focal length and aperture."""
    tags: dict[int, Entry] = {}
    if shot.lens:
        tags |= {42035: text(shot.make), 42036: text(shot.lens), 42037: text(shot.lens_serial)}
    if shot.f_number is not None:
        tags |= {33437: rational(shot.f_number), 37378: rational(2 * math.log2(shot.f_number))}
    if shot.focal_length_mm is not None:
        tags[37386] = rational(shot.focal_length_mm)
    if shot.f_number is not None and shot.focal_length_mm is not None:
        tags[42034] = rational(*[shot.focal_length_mm] * 2, *[shot.f_number] * 2)
    return tags


# --- Frames of a camera that delivers pixels and no file: written atomically as numbered DNGs, read back, hashed ---
# Later stages thus see RAW files, whichever camera took them.


@dataclass(frozen=True)
class OpticsMetadata:
    """Data that such a camera cannot know; written to its files as configured.

    f_number, focal_length_mm, lens : of the lens; "" if it has no name
    pixel_pitch_um : pixel pitch of the sensor
    black : black level of each position of the mosaic, in digital numbers
    """

    f_number: Annotated[float, positive("4.0")] | None = None
    focal_length_mm: Annotated[float, positive("25")] | None = None
    lens: Annotated[str, text_option('"Lens 25 mm"')] = ""
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
        numbers = (path.stem.removeprefix("IMG_") for path in self.path.glob("IMG_*"))
        last = max((int(number) for number in numbers if number.isdecimal()), default=0)
        return self.path / f"IMG_{last + 1:04d}.DNG"

    def keep(
        self, frame: Frame, body: Body, wanted: CameraSettings, requested_s: float, shutter: ShutterTimes | None = None
    ) -> ExposedFile:
        """Write the frame and read it back. Raises FrameWrong if it differs from the request, LineLost."""
        self.check()
        settings = CameraSettings(frame.exposure_s, None, self.optics.f_number)
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
        return self._record(path, wanted, settings, requested_s, shutter)

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
        self, path: Path, wanted: CameraSettings, settings: CameraSettings | None, requested_s: float,
        shutter: ShutterTimes | None,
    ) -> ExposedFile:  # fmt: skip
        """Read a file back; without `settings` those in the file are the photograph's."""
        try:
            facts = self._inspect(path)
        except Exception as error:  # readers may raise anything
            raise FrameWrong(f"{path.name} does not read back: {error}", "check the disk, then repeat") from error
        check_settings(path, facts, wanted)
        settings = settings or CameraSettings(facts.exposure_s, facts.iso, facts.f_number)
        size, received_s = path.stat().st_size, self._clock.now_s()
        return ExposedFile(path, sha256_of(path), size, settings, requested_s, received_s, shutter)


def _unwritable(path: Path, error: OSError) -> LineLost:
    return LineLost(f"{path} cannot be written: {error.strerror}", "make room, or name another folder")
