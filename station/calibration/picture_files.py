"""16-bit pictures for other programs: TIFF, and linear DNG (demosaicked, not developed).

Strips are written one by one, so that a large picture is in memory only once.
Source: TIFF 6.0, sections 2, 3, 8; DNG 1.4, chapters 2 and 4 (PhotometricInterpretation LinearRaw).
"""

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from station.calibration.camera_metadata import EXIF, CameraMetadata, Entry, long, rational, short, text

Linear = npt.NDArray[np.float32]

BLACK, WHITE = 2048, 62048
"""Values of a DNG for 0 and white, with room for noise below black and light above white."""
STRIP_ROWS = 256
GREY, RGB, LINEAR_RAW = 1, 2, 34892


def write_tiff(path: Path, picture: Linear, metadata: CameraMetadata, description: str) -> None:
    """A 16-bit TIFF: linear, from 0, black, to 65535, white; other values are clipped.

    picture : (C, H, W), C = 1 or 3, white = 1
    """
    tags = {262: short(GREY if len(picture) == 1 else RGB), 270: text(description), **metadata.picture}
    _write(path, picture, tags, metadata.exif, lambda rows: np.clip(rows, 0, 1) * 65535)


def write_linear_dng(path: Path, picture: Linear, metadata: CameraMetadata) -> None:
    """A linear DNG, for programs that apply white balance, profile and tone curve as to the camera's RAW.

    picture : (C, H, W), grey or the camera's own red, green and blue, white = 1
    """
    channels = len(picture)
    tags = {
        254: long(0), 262: short(LINEAR_RAW), 50706: (1, 4, bytes((1, 4, 0, 0))), 50707: (1, 4, bytes((1, 1, 0, 0))),
        50708: text("Camera"), 50713: short(1, 1), 50714: short(*[BLACK] * channels), 50717: short(*[WHITE] * channels),
        **({} if channels == 1 else {50721: rational(1, 0, 0, 0, 1, 0, 0, 0, 1, signed=True), 50778: short(21)}),
        **metadata.picture, **metadata.colour,
    }  # fmt: skip
    _write(path, picture, tags, metadata.exif, lambda rows: np.clip(rows * (WHITE - BLACK) + BLACK, 0, 65535))


def _write(
    path: Path, picture: Linear, tags: Mapping[int, Entry], exif: Mapping[int, Entry],
    scaled: Callable[[Linear], Linear],
) -> None:  # fmt: skip
    """Header, directories, and the samples strip by strip."""
    channels, rows, columns = picture.shape
    tops = range(0, rows, STRIP_ROWS)
    sizes = [2 * channels * columns * min(STRIP_ROWS, rows - top) for top in tops]
    every = {
        **tags, 256: long(columns), 257: long(rows), 258: short(*[16] * channels), 259: short(1),
        277: short(channels), 278: long(STRIP_ROWS), 279: long(*sizes), 284: short(1), 305: text("calibration-station"),
    }  # fmt: skip
    with open(path, "wb") as file:
        file.write(_head(every, exif, sizes))
        for top in tops:
            strip = np.moveaxis(picture[:, top : top + STRIP_ROWS], 0, -1)
            file.write(np.ascontiguousarray(np.rint(scaled(strip)).astype("<u2")).tobytes())


def _head(tags: Mapping[int, Entry], exif: Mapping[int, Entry], sizes: list[int]) -> bytes:
    """Header and directories: laid out with offsets of 0, which have the same length, then with the actual ones."""
    links = {273: long(*[0] * len(sizes)), **({EXIF: long(0)} if exif else {})}
    exif_at = 8 + len(_directory({**tags, **links}, 8))
    after = _directory(exif, exif_at) if exif else b""
    data_at = -(-(exif_at + len(after)) // 16) * 16
    offsets = np.cumsum([data_at, *sizes[:-1]])
    links = {273: long(*(int(one) for one in offsets)), **({EXIF: long(exif_at)} if exif else {})}
    head = struct.pack("<2sHI", b"II", 42, 8) + _directory({**tags, **links}, 8) + after
    return head.ljust(data_at, b"\0")


def _directory(tags: Mapping[int, Entry], at: int) -> bytes:
    """A directory at an offset: its entries, then the values that do not fit into them."""
    beyond, entries, values = at + 2 + 12 * len(tags) + 4, b"", b""
    for tag, (kind, count, raw) in sorted(tags.items()):
        place = raw.ljust(4, b"\0")
        if len(raw) > 4:
            place = struct.pack("<I", beyond + len(values))
            values += raw + b"\0" * (len(raw) % 2)
        entries += struct.pack("<HHI", tag, kind, count) + place
    return struct.pack("<H", len(tags)) + entries + bytes(4) + values
