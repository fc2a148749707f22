"""Pictures that a camera or a program developed: JPEG, WebP, HEIC, and PNG or TIFF in colour or with a tone curve.

RAW files without a 2 x 2 mosaic belong to them, linear DNG and those of X-Trans and other mosaics: LibRaw gives their
linear colours on one grid.

Their samples are decoded to light by the tone curve that the file's ICC profile states, or by sRGB's. What cannot be
decoded is what the development did besides: noise reduction, sharpening, local contrast.
"""

import hashlib
import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.raw import GREY_PLANE, Plane, RawFrame, linear_colours, read_photograph
from procedures.reading.development import LINEAR, SRGB, Development, ToneCurve, curve_of_profile, named_curve
from procedures.reading.exposure import read_exposure
from procedures.reading.grey_image import PNG_MAGIC, TIFF_MAGIC, read_levels
from procedures.reading.guard import Room, decoding
from procedures.reading.tiff_tags import COMPRESSION, ICC_PROFILE, ORIENTATION, image_directories

_AGAIN = "copy it again, or export it as TIFF or PNG"
_RGB = "export it as grey or RGB, without transparency"
BYTES = 16  # bytes of a pixel of three colours while it is decoded
COLOURS = {1: (GREY_PLANE,), 3: ("R", "G", "B")}


def is_developed(data: bytes) -> bool:
    """Whether a file's first bytes are of a format that holds developed pictures only."""
    return _format(data, Path()) in LOSSY


def read_developed(path: Path | str, encoding: str | None = None, *, data: bytes | None = None) -> RawFrame:
    """Read planes R, G and B, or Y, of a developed picture.

    Raises BadInput if it is no such file, or cannot be decoded completely.

    encoding : str, "linear" or "srgb"; by default the file's ICC profile, or sRGB where it has none
    data : bytes, content of the file, if already read
    """
    path = Path(path)
    data = read_photograph(path) if data is None else data
    with decoding(str(path), "a picture", _AGAIN):
        kind = _format(data, path)
        levels, coding, icc, exif = _READERS[kind](data, str(path))
        stated = LINEAR if kind == RAW else encoding
        curve = named_curve(stated) if stated else _profiled(icc)
        bits = 8 * levels.dtype.itemsize
        development = Development(kind, curve or named_curve(SRGB), curve is None, bits, coding, icc, exif)
        # planes of levels (H, W, C), decoded; a step is that at half of white
        white = np.float32((1 << development.bits) - 1)
        step = float(development.curve.slope(np.array([0.5]))[0] / white)
        planes = {
            name: Plane(name, development.curve.decoded(np.ascontiguousarray(levels[..., c]) / white), step)
            for c, name in enumerate(COLOURS[levels.shape[2]])
        }
        exposure = read_exposure(BytesIO(data))
    return RawFrame(path, hashlib.sha256(data).hexdigest(), planes, exposure, development=development)


def _profiled(icc: bytes) -> ToneCurve | None:
    """The curve of a profile; None without one, or where it is damaged."""
    try:
        return curve_of_profile(icc) if icc else None
    except (ValueError, struct.error, KeyError):
        return None


# --- formats ---

LOSSY, RAW = ("JPEG", "WEBP", "HEIF"), "RAW"
JPEG_IN_TIFF = ((6,), (7,))  # compressions of a TIFF by JPEG
HEIF_TURN, UPRIGHT = b"\0\0\0\x09irot", (1, 8, 3, 6)  # box of anticlockwise quarters, and EXIF's orientation for each
USUAL_CODING = 0.01  # error of block coding where the file does not state its tables, as part of white's level


def _format(data: bytes, path: Path) -> str:
    """The format by the file's first bytes; RAW where it is no other."""
    if data.startswith(b"\xff\xd8\xff"):
        return "JPEG"
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "WEBP"
    if data[4:8] == b"ftyp" and data[8:12] in (b"heic", b"heix", b"hevc", b"mif1", b"msf1", b"heim", b"heis"):
        return "HEIF"
    if data.startswith(PNG_MAGIC):
        return "PNG"
    return "TIFF" if data.startswith(TIFF_MAGIC) and path.suffix.lower() in (".tif", ".tiff") else RAW


def _read_8(data: bytes, name: str) -> tuple[npt.NDArray[np.uint8], float, bytes, bytes]:
    """Levels (H, W, C) of a file with block coding, its coding error, profile and metadata."""
    from procedures.reading.development import coding_error  # here: scipy.fft, slow to load

    with pillow(heif=data[4:8] == b"ftyp", name=name).open(BytesIO(data)) as image:
        Room(name).take(BYTES * image.width * image.height, f"{image.width} x {image.height} pixels")
        if image.mode == "CMYK":
            raise BadInput(f"the colours of a picture must be grey or RGB; {name} has CMYK", _RGB)
        if "A" in image.getbands() and image.getchannel("A").getextrema()[0] < 255:
            raise BadInput(f"a picture must be opaque; {name} has transparency", _RGB)
        icc, exif = image.info.get("icc_profile") or b"", image.info.get("exif") or b""
        levels = np.asarray(image if image.mode == "L" else image.convert("RGB"), dtype=np.uint8)
        if data[4:8] == b"ftyp" and (turn := data.partition(HEIF_TURN)[2][:1]):  # decoded as turned: back to the sensor
            quarters, tags = turn[0] & 3, image.getexif()
            tags[ORIENTATION] = UPRIGHT[quarters]
            levels, exif = np.rot90(levels, -quarters), tags.tobytes()
        levels, steps = levels.reshape(*levels.shape[:2], -1), getattr(image, "quantization", {}).get(0)
    return levels, coding_error(levels, steps) if steps else USUAL_CODING, icc, exif


def pillow(*, heif: bool, name: str = "the picture") -> Any:
    """Pillow's `Image`, with HEIC if needed. Raises BadInput where its reader is not installed."""
    from PIL import Image

    if heif:
        try:
            from pillow_heif import register_heif_opener
        except ImportError as error:
            remedy = "install it: pip install 'calibration-station[heif]'; or export the picture as JPEG or TIFF"
            raise BadInput(f"{name} is a HEIC file, whose reader is not installed", remedy) from error
        register_heif_opener()
    return Image


def _read_lossless(data: bytes, name: str) -> tuple[npt.NDArray[Any], float, bytes, bytes]:
    """Levels (H, W, C) of a PNG or TIFF of 8 or 16 bits, its coding error, profile and metadata."""
    levels = read_levels(data, name)
    if data.startswith(TIFF_MAGIC):
        tags = image_directories(BytesIO(data), name)[0]
        coding = USUAL_CODING if tags.get(COMPRESSION) in JPEG_IN_TIFF else 0.0
        return levels, coding, bytes(int(one) for one in tags.get(ICC_PROFILE, ())), b""
    with pillow(heif=False).open(BytesIO(data)) as image:
        icc, exif = image.info.get("icc_profile") or b"", image.info.get("exif") or b""
    return levels, 0.0, icc, exif


def _read_raw(data: bytes, name: str) -> tuple[npt.NDArray[np.uint16], float, bytes, bytes]:
    return linear_colours(data, name), 0.0, b"", b""


_READERS = {**dict.fromkeys(LOSSY, _read_8), "PNG": _read_lossless, "TIFF": _read_lossless, RAW: _read_raw}
