"""Reading of photographs into arrays: mosaic planes of RAW files, grey images, without demosaicking."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from procedures.display import summary
from procedures.numerics.arrays import Array32
from procedures.outcome import BadInput, BadParameter, ColourInput
from procedures.reading.arrays import checked_array
from procedures.reading.development import Development
from procedures.reading.exposure import Exposure, read_exposure
from procedures.reading.grey_image import PNG_MAGIC, TIFF_MAGIC, Samples, read_grey
from procedures.reading.guard import Room, decoding, open_file, read_file
from procedures.reading.library_noise import captured_noise, no_pixels, stuck_pixels
from procedures.reading.motion_records import ImuRecord, ShakerPath, ShakerResponse, measured_path
from procedures.reading.sensor_dump import PICTURE, DumpLayout, has_raw_header
from procedures.reading.tiff_tags import (
    BLACK_LEVEL,
    CFA_PATTERN,
    CFA_REPEAT,
    Tags,
    has_directory,
    is_monochrome,
    mosaic_tags,
    written_black,
    written_black_everywhere,
)

__all__ = [
    "GREY_PLANE", "MOSAIC_PLANES", "Exposure", "ImuRecord", "Plane", "RawFrame", "ShakerPath", "ShakerResponse",
    "default_plane", "measured_path", "read_frame", "read_photograph", "read_planes",
]  # fmt: skip

MOSAIC_PLANES = ("R", "G1", "G2", "B")  # planes of a 2 x 2 mosaic; G1 lies on the red rows
GREY_PLANE = "Y"  # plane of a grey image, or of a sensor without a mosaic


@dataclass(frozen=True)
class Plane:
    """One linear colour plane of a photograph.

    name : str, "R", "G1", "G2", "B" of a mosaic (G1 on the red rows), "Y" of a grey image or a monochrome sensor
    samples : (rows, columns) float32
        Black level subtracted, scaled so that white is 1; values below black stay negative.
    quantisation : float, one step of the digital numbers, in units of `samples`
    pitch : int, sensor pixels per pixel of the plane: 2 for a Bayer plane, 1 for a grey image
    origin : (int, int)
        Position (x, y) of the plane's first pixel on the sensor, counted from the first pixel that is no border.
    black, white : float, digital numbers of 0 and 1; where black varies over the plane, its mean
    bad_pixels : (n, 2) intp, [row, column] of pixels stuck at white or at the digital number 0
    raw : bool, whether it comes from a RAW file or a sensor's dump, processed by the camera at most
    """

    name: str
    samples: Array32
    quantisation: float
    pitch: int = 1
    origin: tuple[int, int] = (0, 0)
    black: float = 0.0
    white: float = 1.0
    bad_pixels: npt.NDArray[np.intp] = field(default_factory=no_pixels)
    raw: bool = False

    __repr__ = summary

    @classmethod
    def from_array(
        cls,
        array: npt.NDArray[Any],
        name: str = GREY_PLANE,
        *,
        black: float = 0.0,
        white: float | None = None,
        raw: bool = False,
    ) -> "Plane":
        """Plane of linear samples (rows, columns).

        black, white : sample values of black and white. White is 1 by default for floating-point samples, which are
        taken as quantised to 16 bits, and the largest value of an integer type. raw : whether they are a sensor's,
        unprocessed; otherwise uncertainties include processing that the samples do not exclude. Raises BadInput if it
        is not two-dimensional, or not all samples are finite; BadParameter unless white exceeds black.
        """
        whole = np.issubdtype(array.dtype, np.integer)
        if white is None:
            white = float(np.iinfo(array.dtype).max) if whole else 1.0
        if not 0 < white - black < np.inf:
            raise BadParameter(
                f"white must exceed black; got {white:g} and {black:g}", "give the levels of the samples"
            )
        samples = checked_array(array, "a plane", (None, None), remedy="give one linear channel, as image[..., 1]")
        step = 1 / (white - black) if whole else 1 / 65535
        return cls(
            name, ((samples - black) / (white - black)).astype(np.float32), step, black=black, white=white, raw=raw
        )


UNLIKELY_IN_RAW = 0.3  # prior of processing as a cause for a RAW file, relative to a picture written by a program


def unprocessed(raw: bool, remedy: str) -> str:
    """Remedy against processing, for RAW files or other pictures."""
    return "switch off noise reduction and lossy compression of RAW files in the camera" if raw else remedy


@dataclass(frozen=True)
class RawFrame:
    """A photograph: its planes by name, in the order R, G1, G2, B, and its provenance.

    `imu` and `shaker_path` give the motion during the exposure, where a session recorded it. `development` states how
    the file of a developed picture encodes light; None for linear samples of a sensor.
    """

    path: Path
    sha256: str
    planes: Mapping[str, Plane]
    exposure: Exposure
    imu: ImuRecord | None = None
    shaker_path: ShakerPath | None = None
    development: Development | None = None

    @property
    def guide(self) -> Plane:
        """Plane for detection and advice: G1 of a mosaic, otherwise the first."""
        return self.planes.get("G1") or next(iter(self.planes.values()))

    __repr__ = summary


PlaneLike = Plane | npt.NDArray[Any]
"""A plane, or an array (rows, columns) of linear samples as `Plane.from_array` takes it."""
FrameLike = RawFrame | PlaneLike


def as_plane(image: object) -> Plane:
    """A plane, given as such or as an array. Raises TypeError for anything else, and as `Plane.from_array`."""
    if isinstance(image, Plane):
        return image
    if isinstance(image, np.ndarray):
        return Plane.from_array(image)
    remedy = "pass a Plane, as read_frame(path).planes['G1'], or an array (rows, columns) of linear samples"
    raise TypeError(f"a plane is needed, got {type(image).__name__}: {remedy}")


def as_frame(image: object, name: str = "array") -> RawFrame:
    """A photograph, given as such or as its one plane. Raises as `as_plane`."""
    if isinstance(image, RawFrame):
        return image
    plane = as_plane(image)
    return RawFrame(Path(name), "", {plane.name: plane}, Exposure())


def read_frame(
    path: Path | str, names: Sequence[str] | None = None, layout: DumpLayout | None = None, *, data: bytes | None = None
) -> RawFrame:
    """Read the planes of a photograph, linear, black 0 and white 1, with its exposure data.

    RAW files with a 2 x 2 mosaic give R, G1, G2 and B; grey PGM, PNG and TIFF files and monochrome DNGs give Y.

    path : path of the file
    names : sequence of str, planes to read; all by default. Others take no memory.
    layout : DumpLayout, layout of a sensor's samples in a file without a header or a grey picture; the file is then
        read only in this layout
    data : bytes, content of the file, if already read. Hash and planes always refer to the same bytes, even if the file
        is replaced meanwhile.

    Raises BadInput if there is no such file, it is not a linear mosaic or grey image, or parts of it are missing;
    BadParameter if the file does not have a requested plane.
    """
    path = Path(path)
    data = read_photograph(path) if data is None else data
    planes, exposure = _decoded(path, data, names, layout)
    return RawFrame(path, hashlib.sha256(data).hexdigest(), planes, exposure)


def read_planes(path: Path, names: Sequence[str]) -> Mapping[str, Plane]:
    """Read the planes of a photograph without a record, omitting the hash, which takes a sixth of the time."""
    return _decoded(path, read_photograph(path), names, None)[0]


def _decoded(
    path: Path, data: bytes, names: Sequence[str] | None, layout: DumpLayout | None
) -> tuple[dict[str, Plane], Exposure]:
    with decoding(str(path), "a photograph", _COPY):
        if layout:
            places = layout.first_pixels()
            _check_names(names, tuple(places), path)
            levels = layout.read(data, str(path))
            black, white = np.array(layout.black, np.float32), float(layout.white)
            exposure = _exposure_of_grey(BytesIO(data)) if layout.kind == PICTURE else Exposure()
            if GREY_PLANE in places:
                return {GREY_PLANE: _scaled_plane(GREY_PLANE, levels, black, white)}, exposure
            return {
                name: _scaled_plane(name, levels[row::2, column::2], black, white, (column, row))
                for name, (row, column) in places.items()
                if names is None or name in names
            }, exposure
        read = _read_grey if _kind(path, BytesIO(data)) in _GREY else _read_mosaic
        return read(path, BytesIO(data), names)


def read_photograph(path: Path) -> bytes:
    """Read the content of a photograph's file. Raises BadInput if it cannot be read, is not a file, or is too large."""
    return read_file(path)


def default_plane(path: Path | str, layout: DumpLayout | None = None) -> str:
    """Default plane: G1 of a mosaic, otherwise Y. Raises as `read_frame`."""
    if layout:
        return GREY_PLANE if GREY_PLANE in layout.first_pixels() else "G1"
    with open_file(Path(path)) as file, decoding(str(path), "a photograph", _COPY):
        grey = _kind(Path(path), file) in _GREY or is_monochrome(mosaic_tags(file, str(path)))
        return GREY_PLANE if grey else "G1"


# --- kinds of file ---

_GREY = ("pgm", "png", "tiff")
_PICTURES = {
    "JPEG": rb"\xff\xd8\xff", "PPM": rb"P[36]", "BMP": rb"BM.{4}\0{4}", "GIF": rb"GIF8", "WebP": rb"RIFF.{4}WEBP",
    "HEIC": rb".{4}ftyp(he|mif|msf)", "AVIF": rb".{4}ftypavi", "JPEG 2000": rb"\0{3}\x0cjP", "OpenEXR": rb"v/1\x01",
}  # fmt: skip
_EXPORT = "give the camera's RAW file, or export one linear plane as a grey 16 bit TIFF, named .tif"
_DUMP = "give the camera's RAW file; for a sensor's dump give the layout: --raw WIDTHxHEIGHT,RGGB,u16le,BLACK,WHITE"


def _kind(path: Path, file: BinaryIO) -> str:
    """ "pgm", "png", "tiff" or "raw", by the file's first bytes; only TIFF and RAW are distinguished by the suffix."""
    head = file.read(512)
    holds_mosaic, begins_as_tiff = bool(mosaic_tags(file, str(path))), has_directory(file)
    if not head:
        raise BadInput(f"{path} is empty", "copy the photograph from the camera's card again")
    if head[:2] in (b"P2", b"P5"):
        return "pgm"
    if head.startswith(PNG_MAGIC):
        return "png"
    if head.startswith(TIFF_MAGIC) and path.suffix.lower() in (".tif", ".tiff") and not holds_mosaic:
        return "tiff"
    # raise BadInput for formats without a linear plane
    if kind := next((name for name, form in _PICTURES.items() if re.match(form, head, re.DOTALL)), None):
        raise ColourInput(f"a RAW file or one linear plane is required; {path} is of the format {kind}", _EXPORT)
    if _is_text(head) and not has_raw_header(head):
        raise BadInput(f"{path} is a text file, not a photograph", _EXPORT)
    if not has_raw_header(head) or (head.startswith(TIFF_MAGIC) and not begins_as_tiff):
        raise BadInput(f"{path} must have the header of a RAW format; it has none", _DUMP)
    return "raw"


def _is_text(head: bytes) -> bool:
    try:
        text = head[: len(head) - 3 if len(head) > 3 else None].decode("utf-8")
    except UnicodeDecodeError:
        return False
    return all(letter.isprintable() or letter.isspace() for letter in text)


# --- grey images ---


def _read_grey(path: Path, file: BytesIO, names: Sequence[str] | None) -> tuple[dict[str, Plane], Exposure]:
    _check_names(names, (GREY_PLANE,), path)
    levels, white = read_grey(file.getvalue(), str(path))
    plane = _scaled_plane(GREY_PLANE, levels, np.zeros((), np.float32), float(white), raw=False)
    return {GREY_PLANE: plane}, _exposure_of_grey(file)


def _exposure_of_grey(file: BytesIO) -> Exposure:
    """The exposure data of a grey picture; a PGM has none."""
    return Exposure(sources={}) if file.getvalue()[:2] in (b"P2", b"P5") else read_exposure(file)


# --- mosaics ---


def _read_mosaic(path: Path, file: BytesIO, names: Sequence[str] | None) -> tuple[dict[str, Plane], Exposure]:
    import rawpy

    tags = mosaic_tags(file, str(path))
    failure: Exception | None = None
    planes_and_exposure: tuple[dict[str, Plane], Exposure] | None = None
    file.seek(0)
    with captured_noise() as noise:
        try:
            with rawpy.imread(file) as raw:  # decodes on first access to the samples
                rows, columns = raw.sizes.raw_height, raw.sizes.raw_width
                Room(str(path)).take(BYTES * rows * columns, f"{columns} x {rows} samples")
                planes_and_exposure = _mosaic_planes(path, raw, tags, names), read_exposure(file, raw)
        except rawpy.LibRawError as error:
            failure = error
    if noise.errors or isinstance(failure, rawpy.LibRawIOError):
        raise BadInput(f"{path} is truncated or damaged: RAW data are missing", _COPY) from failure
    if planes_and_exposure is None:
        version = ".".join(map(str, rawpy.libraw_version))
        raise BadInput(f"{path} is not a RAW file that LibRaw {version} can open", _EXPORT) from failure
    return planes_and_exposure


def linear_colours(data: bytes, name: str) -> npt.NDArray[np.uint16]:
    """Colours (rows, columns, channels) of a RAW file of any mosaic or none, demosaicked by LibRaw, linear in light.

    They are the camera's own without white balance, from 0, black, to 65535, white. Raises BadInput for other files.
    """
    import rawpy

    repeat = mosaic_tags(BytesIO(data), name).get(CFA_REPEAT, (2, 2))
    with captured_noise() as noise:
        try:
            with rawpy.imread(BytesIO(data)) as raw:
                if tuple(map(int, repeat)) not in {(2, 2), (6, 6)} or raw.num_colors > 3:
                    reason = f"a mosaic must have three colours in 2 x 2 or 6 x 6 pixels; {name} has another"
                    raise BadInput(reason, _OTHER_CAMERA)
                Room(name).take(4 * BYTES * raw.sizes.width * raw.sizes.height, "pixels of three colours")
                black = max(raw.black_level_per_channel)
                colours = raw.postprocess(
                    gamma=(1, 1), no_auto_bright=True, output_bps=16, output_color=rawpy.ColorSpace.raw,
                    user_wb=[1.0] * 4, user_flip=0, adjust_maximum_thr=0.0,
                    user_sat=int(raw.white_level - black),  # LibRaw's own is the largest sample
                )  # fmt: skip
        except rawpy.LibRawError as error:
            raise BadInput(f"{name} is no JPEG, WebP, HEIC, PNG, TIFF or RAW file", "give one of these") from error
    if noise.errors:
        raise BadInput(f"{name} is truncated or damaged: RAW data are missing", _COPY)
    return np.atleast_3d(np.asarray(colours, dtype=np.uint16))


_COPY = "copy it from the camera's card again"


BYTES = 4  # bytes of a sample in memory


def _mosaic_planes(path: Path, raw: Any, tags: Tags, names: Sequence[str] | None) -> dict[str, Plane]:
    if is_monochrome(tags):
        return {GREY_PLANE: _monochrome_plane(path, raw, tags, names)}
    _check_bayer(path, raw, tags)
    _check_names(names, MOSAIC_PLANES, path)
    size = raw.sizes
    visible = raw.raw_image_visible
    planes = {}
    for name, (row, column) in _positions(raw).items():
        if names is None or name in names:
            first = (size.top_margin + row, size.left_margin + column)
            black = _black(path, raw, tags, first, visible[row::2, column::2].shape)
            _check_white(path, raw, black)
            planes[name] = _scaled_plane(name, visible[row::2, column::2], black, float(raw.white_level), (column, row))
    return planes


def _monochrome_plane(path: Path, raw: Any, tags: Tags, names: Sequence[str] | None) -> Plane:
    """Plane of a sensor without a mosaic; a missing black level is 0."""
    _check_names(names, (GREY_PLANE,), path)
    visible, first = raw.raw_image_visible, (raw.sizes.top_margin, raw.sizes.left_margin)
    black = np.zeros((), np.float32)
    if BLACK_LEVEL in tags:
        black = written_black_everywhere(tags, first, visible.shape, str(path))
    _check_white(path, raw, black)
    return _scaled_plane(GREY_PLANE, visible, black, float(raw.white_level))


def _check_white(path: Path, raw: Any, black: Array32) -> None:
    if raw.white_level <= black.max():
        reason = f"{path} must have its white level above its black level {black.max():g}; it is {raw.white_level}"
        raise BadInput(reason, _COPY)


def _check_bayer(path: Path, raw: Any, tags: Tags) -> None:
    """Raise BadInput unless the file holds a 2 x 2 mosaic of red, green, green and blue."""
    # LibRaw gives arbitrary answers for a DNG without a colour pattern
    if raw.num_colors == 1 or (tags and CFA_PATTERN not in tags):
        raise BadInput(f"{path} is from a monochrome sensor; a Bayer mosaic is required", _MONOCHROME)
    try:
        pattern = raw.raw_pattern if raw.raw_type.name == "Flat" else None
    except NotImplementedError as error:  # rawpy supports 2 x 2 and 6 x 6
        raise BadInput(f"{path} must have a 2 x 2 mosaic: {error}", _OTHER_CAMERA) from error
    if pattern is None:
        raise ColourInput(f"{path} is already demosaicked; a mosaic is required", _UNDEVELOPED)
    rows, columns = pattern.shape
    if (rows, columns) == (6, 6):
        raise ColourInput(f"{path} has the 6 x 6 mosaic of X-Trans; a 2 x 2 Bayer mosaic is required", _OTHER_CAMERA)
    colours = sorted(raw.color_desc[i : i + 1] for i in pattern.ravel())
    if (rows, columns) != (2, 2) or colours != [b"B", b"G", b"G", b"R"] or not _has_diagonal_greens(pattern):
        reason = f"{path} must have a 2 x 2 mosaic of red, green, green, blue; it has another of {rows} x {columns}"
        raise ColourInput(reason, _OTHER_CAMERA)


_UNDEVELOPED = "give the RAW file as the camera wrote it, not a converted or reduced one"
_MONOCHROME = "export its plane as a linear grey 16 bit TIFF"
_OTHER_CAMERA = "use a camera with a Bayer mosaic"


def _has_diagonal_greens(pattern: npt.NDArray[np.uint8]) -> bool:
    return {pattern[0, 0], pattern[1, 1]} == {1, 3} or {pattern[0, 1], pattern[1, 0]} == {1, 3}


def _positions(raw: Any) -> dict[str, tuple[int, int]]:
    """(row, column) of each plane's first pixel in the visible image; G1 is the green on the red rows."""
    top, left = raw.sizes.top_margin, raw.sizes.left_margin
    at = {raw.raw_color(top + row, left + column): (row, column) for row in (0, 1) for column in (0, 1)}
    row, column = at[0]
    return {"R": (row, column), "G1": (row, 1 - column), "G2": (1 - row, column), "B": (1 - row, 1 - column)}


def _black(path: Path, raw: Any, tags: Tags, first: tuple[int, int], shape: tuple[int, int]) -> Array32:
    """Black level of a plane in digital numbers, one number or one per row and column.

    The file's level (DNG BlackLevel, relative to ActiveArea) has priority: LibRaw replaces it by the mean of
    MaskedAreas, uses 0 where the repeat pattern is missing, and does not move it when an odd ActiveArea moves the
    mosaic. Otherwise LibRaw's level is used, which is by colour index, not by position.
    """
    if BLACK_LEVEL in tags:
        return written_black(tags, first, shape, str(path))
    return np.array(raw.black_level_per_channel[raw.raw_color(*first)], dtype=np.float32)


# --- shared ---


def _check_names(names: Sequence[str] | None, available: Sequence[str], path: Path) -> None:
    for name in names or ():
        if name not in available:
            raise BadParameter(
                f"the plane must be one of {', '.join(available)} for {path}; got {name!r}", "name one of these"
            )


def _scaled_plane(
    name: str, levels: Samples, black: Array32, white: float, position: tuple[int, int] | None = None,
    *, raw: bool = True,
) -> Plane:  # fmt: skip
    """Plane from digital numbers; `position` (x, y) is that in the 2 x 2 cell of a mosaic."""
    mean_black = float(np.mean(black))
    samples = levels.astype(np.float32)
    samples -= black
    samples *= np.float32(1 / (white - mean_black))
    pitch, origin = (1, (0, 0)) if position is None else (2, position)
    bad = stuck_pixels(samples, -mean_black / (white - mean_black))
    return Plane(name, samples, 1 / (white - mean_black), pitch, origin, mean_black, white, bad, raw)
