"""Readers of grey PGM, PNG and TIFF files: samples and full scale."""

import io
import re
import struct
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, ColourInput
from procedures.reading.guard import Room
from procedures.reading.library_noise import captured_noise
from procedures.reading.tiff_tags import (
    BITS_PER_SAMPLE,
    COMPRESSION,
    FLOATING,
    LENGTH,
    PHOTOMETRIC,
    PLANAR,
    SAMPLE_FORMAT,
    SAMPLES_PER_PIXEL,
    TILE_LENGTH,
    TILE_WIDTH,
    WHITE_IS_ZERO,
    WIDTH,
    Tags,
    as_stored,
    image_directories,
)

Samples = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_EXPORT = "export one linear colour plane as an 8 or 16 bit grey PGM, PNG or TIFF, or give the RAW file itself"
_AGAIN = "copy or export it again"
BYTES, PLAIN_BYTES = 4, 80  # bytes of a sample in memory, as a number and as text
LONGEST_HEAD = 1 << 16  # greatest length of a PGM's header with its comments, in bytes


def read_grey(data: bytes, name: str) -> tuple[Samples, int]:
    """Samples (rows, columns) and full scale of a grey PGM, PNG or TIFF, by its first bytes. Raises BadInput."""
    if data[:2] in (b"P2", b"P5"):
        return read_pgm(data, name)
    if data.startswith(PNG_MAGIC):
        return read_png(data, name)
    if data.startswith(TIFF_MAGIC):
        return read_tiff(data, name)
    raise BadInput(f"{name} is no grey PGM, PNG or TIFF", _EXPORT)


def read_pgm(data: bytes, name: str) -> tuple[Samples, int]:
    """Samples (rows, columns) of a PGM file, plain or raw, and the level of white: the header's maxval.

    Raises BadInput if the header is broken, the maxval is outside 1..65535, samples are missing or exceed the maxval.

    Source: The Netpbm format specification pgm(5): two bytes a sample, big-endian, from a maxval of 256 on.
    """
    header = _PGM_HEADER.match(data[:LONGEST_HEAD])
    if header is None:
        raise BadInput(f"{name} is a PGM file without width, height and maxval", _AGAIN)
    columns, rows, white = (int(header[group]) for group in ("columns", "rows", "white"))
    if not (columns and rows and 1 <= white <= 65535):
        reason = f"a PGM must have pixels and a maxval of 1 to 65535; {name} has {columns} x {rows}, {white}"
        raise BadInput(reason, _AGAIN)
    read = _plain_samples if data[:2] == b"P2" else _raw_samples
    levels = read(data[header.end() :], columns * rows, white, name)
    if levels.max() > white:
        raise BadInput(f"samples must not exceed the maxval {white}; {name} has {levels.max()}", _AGAIN)
    return levels.reshape(rows, columns), white


_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PGM_HEADER = re.compile(
    rb"P[25]" + _GAP + rb"(?P<columns>\d{1,9})" + _GAP + rb"(?P<rows>\d{1,9})" + _GAP + rb"(?P<white>\d{1,9})"
    rb"(?:[ \t]*#[^\r\n]*[\r\n]|\s)"
)


def _raw_samples(body: bytes, n: int, white: int, name: str) -> Samples:
    kind = np.dtype(np.uint8 if white < 256 else ">u2")
    _check_count(len(body) // kind.itemsize, n, name)
    Room(name).take(BYTES * n, f"{n} samples")
    return cast(Samples, np.frombuffer(body, kind, n))


def _plain_samples(body: bytes, n: int, white: int, name: str) -> Samples:
    Room(name).take(PLAIN_BYTES * min(n, len(body) // 2 + 1), f"{n} samples as text")
    words = re.sub(rb"#[^\r\n]*", b"", body).split(None, n)[:n]
    _check_count(len(words), n, name)
    try:
        levels = np.array(words, dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise BadInput(f"plain PGM samples must be whole numbers; {name} has other text", _AGAIN) from error
    if levels.min() < 0 or levels.max() > 65535:
        raise BadInput(f"{name} has samples from {levels.min()} to {levels.max()}, outside its maxval {white}", _AGAIN)
    return levels.astype(np.uint16)


def _check_count(count: int, n: int, name: str) -> None:
    if count < n:
        raise BadInput(f"{name} is truncated: its header declares {n} samples; it has {count}", _AGAIN)


def read_png(data: bytes, name: str) -> tuple[Samples, int]:
    """Samples (rows, columns) of a grey PNG file and the level of white, 255 or 65535.

    Raises BadInput if the file has colours, a palette, transparency or another depth, or does not end with its last
    chunk.
    """
    if len(data) < 26:
        raise BadInput(f"{name} is truncated: {len(data)} bytes of a PNG", _AGAIN)
    depth, colour = data[24], data[25]
    if colour != 0:
        kinds = {2: "colours", 3: "a palette", 4: "transparency", 6: "colours and transparency"}
        refused = ColourInput if colour in (2, 3, 6) else BadInput
        raise refused(
            f"a photograph must be one linear grey plane; {name} has {kinds.get(colour, 'an unknown type')}", _EXPORT
        )
    _check_depth(depth, name)
    columns, rows = struct.unpack_from(">II", data, 16)
    Room(name).take(BYTES * rows * columns, f"{columns} x {rows} samples")
    if not png_ends(data):
        raise BadInput(f"{name} is truncated: the PNG has no end chunk", _AGAIN)
    return _decode(data, name), (1 << depth) - 1


def png_ends(data: bytes) -> bool:
    """Whether a PNG file's chunks are complete: decoders allocate the size that a chunk declares."""
    at = len(PNG_MAGIC)
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"IEND":
            return True
        at += 12 + size
    return False


def read_tiff(data: bytes, name: str) -> tuple[Samples, int]:
    """Samples (rows, columns) of a grey TIFF file's first page and the level of white, 255 or 65535.

    Raises BadInput if the file has colours, another depth than 8 or 16 bit integers, or cannot be decoded completely.
    """
    _check_page(_first_page(data, name), name)
    levels = _decode(data, name)
    if levels.ndim != 2:
        raise ColourInput(f"a photograph must be one linear grey plane; {name} has a palette", _EXPORT)
    if levels.dtype not in (np.uint8, np.uint16):
        raise BadInput(f"grey levels must be integers of 8 or 16 bits; {name} has {levels.dtype}", _EXPORT)
    return levels, int(np.iinfo(levels.dtype).max)


def _first_page(data: bytes, name: str) -> Tags:
    """Tags of a TIFF's first page. Raises BadInput if there is none, another is as large, or it has no integers."""
    pages = image_directories(io.BytesIO(data), name)
    if not pages:
        raise BadInput(f"{name} is truncated or damaged: it cannot be decoded completely", _AGAIN)
    sizes = [_first(tags, WIDTH, 0) * _first(tags, LENGTH, 0) for tags in pages]
    if max(sizes[1:], default=0) >= sizes[0]:
        reason = f"the first page of a TIFF must be the largest of {len(pages)}; a later one of {name} is not smaller"
        raise BadInput(reason, "save the page that is the photograph as a file of its own")
    if _first(pages[0], SAMPLE_FORMAT, 1) == FLOATING:
        raise BadInput(f"a picture must have integers of 8 or 16 bits; {name} has floating-point numbers", _COLOURS)
    return pages[0]


def _check_page(tags: Tags, name: str) -> None:
    """Raise BadInput if a TIFF's page is not a grey plane, or too large."""
    channels = _first(tags, SAMPLES_PER_PIXEL, 1)
    if channels != 1:
        refused = ColourInput if channels in (3, 4) else BadInput
        raise refused(f"a photograph must be one linear grey plane; {name} has {channels} channels", _EXPORT)
    _check_depth(_first(tags, BITS_PER_SAMPLE, 1), name)
    if _first(tags, PHOTOMETRIC, -1) == WHITE_IS_ZERO:
        raise BadInput(f"grey levels must increase with light; {name} is a TIFF with white as 0", _EXPORT)
    columns, rows = _first(tags, WIDTH, 0), _first(tags, LENGTH, 0)
    tile = max(columns, _first(tags, TILE_WIDTH, 1)) * max(rows, _first(tags, TILE_LENGTH, 1))
    Room(name).take(BYTES * tile, f"{columns} x {rows} samples")


def _first(tags: Tags, code: int, default: int) -> int:
    return int((*tags.get(code, ()), default)[0])


def read_levels(data: bytes, name: str) -> Samples:
    """Samples (rows, columns, 1 or 3) of a TIFF or PNG file, grey or red, green and blue, of 8 or 16 bits.

    Raises BadInput if the file has transparency or another depth, or cannot be decoded completely.
    """
    columns, rows = _declared_size(data, name)
    Room(name).take(3 * BYTES * rows * columns, f"{columns} x {rows} pixels of three colours")
    if data.startswith(PNG_MAGIC) and not png_ends(data):
        raise BadInput(f"{name} is truncated: the PNG has no end chunk", _AGAIN)
    levels = np.atleast_3d(_decode(data, name))
    white = {"uint8": 255, "uint16": 65535}.get(levels.dtype.name)
    if white is None:
        raise BadInput(f"a picture must have integers of 8 or 16 bits; {name} has {levels.dtype}", _COLOURS)
    if levels.shape[2] == 4 and (levels[..., 3] == white).all():  # opaque
        levels = levels[..., :3]
    if levels.shape[2] not in (1, 3):
        raise BadInput(f"a picture must have one channel or three; {name} has {levels.shape[2]}", _COLOURS)
    return np.ascontiguousarray(levels[..., ::-1])  # OpenCV has blue first


def _declared_size(data: bytes, name: str) -> tuple[int, int]:
    """Declared columns and rows of a PNG or TIFF. Raises BadInput where there are none, or its colours are not RGB."""
    if data.startswith(PNG_MAGIC) and len(data) >= 26:
        columns, rows = struct.unpack_from(">II", data, 16)
        return columns, rows
    tags = _first_page(data, name)
    _check_colours(tags, name)
    tile = max(1, _first(tags, TILE_WIDTH, 1)), max(1, _first(tags, TILE_LENGTH, 1))
    return max(_first(tags, WIDTH, 0), tile[0]), max(_first(tags, LENGTH, 0), tile[1])


_RGB = (1, 2, 3, 6)
"""PhotometricInterpretation of grey from black, RGB, a palette and YCbCr, which OpenCV decodes to grey or RGB."""
_SEPARATE = 2


def _check_colours(tags: Tags, name: str) -> None:
    """Raise BadInput for a TIFF's page that OpenCV decodes to other colours without an error."""
    if (kind := _first(tags, PHOTOMETRIC, 2)) not in _RGB:
        kinds = {WHITE_IS_ZERO: "white as 0", 5: "CMYK", 8: "CIE L*a*b*", 9: "CIE L*a*b*"}
        reason = f"the colours of a picture must be grey or RGB; {name} has {kinds.get(kind, f'others, {kind}')}"
        raise BadInput(reason, _COLOURS)
    channels, depth = _first(tags, SAMPLES_PER_PIXEL, 1), _first(tags, BITS_PER_SAMPLE, 8)
    if channels > 1 and depth > 8 and _first(tags, PLANAR, 1) == _SEPARATE:
        reason = f"the colours of a pixel must be stored together; {name} has each colour as a plane of its own"
        raise BadInput(reason, "export it with interleaved colours (PlanarConfiguration 1)")


_COLOURS = "export it as grey or RGB TIFF or PNG of 8 or 16 bits, without transparency"


def _check_depth(depth: int, name: str) -> None:
    if depth not in (8, 16):
        raise BadInput(f"grey levels must have 8 or 16 bits; {name} has {depth}", _EXPORT)


def _decode(data: bytes, name: str) -> Samples:
    """Samples of the file, unchanged. Errors that OpenCV reports raise BadInput, as it returns partial pictures too."""
    import cv2

    with captured_noise() as noise:
        try:
            image: Any = cv2.imdecode(np.frombuffer(as_stored(data), np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:
            image = None
    if image is None or noise.errors:
        tags: Tags = next(iter(image_directories(io.BytesIO(data), name)), {})
        compression, stored = _first(tags, COMPRESSION, 1), "tiles" if TILE_WIDTH in tags else "strips"
        if stored == "tiles" or compression not in _DECODED:
            reason = f"{name} is damaged, or a TIFF of a kind that is not read: compression {compression}, in {stored}"
            raise BadInput(reason, "export it in strips, uncompressed or by LZW or Deflate")
        raise BadInput(f"{name} is truncated or damaged: it cannot be decoded completely", _AGAIN)
    return cast(Samples, image)


_DECODED = (1, 5, 7, 8, 32773, 32946)
"""Compressions of TIFF that OpenCV decodes: none, LZW, JPEG, Deflate, PackBits."""
