"""16-bit pictures for other programs: TIFF, and linear DNG (demosaicked, not developed).

Strips are written one by one, so that a large picture is in memory only once.
Source: TIFF 6.0, sections 2, 3, 8; DNG 1.4, chapters 2 and 4 (PhotometricInterpretation LinearRaw).
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drivers.tiff import Entry, byte, head, long, rational, short, text
from station.calibration.camera_metadata import CameraMetadata

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
        254: long(0), 262: short(LINEAR_RAW), 50706: byte(1, 4, 0, 0), 50707: byte(1, 1, 0, 0),
        50708: text("Camera"), 50713: short(1, 1), 50714: short(*[BLACK] * channels), 50717: short(*[WHITE] * channels),
        **({} if channels == 1 else {50721: rational(1, 0, 0, 0, 1, 0, 0, 0, 1, signed=True), 50778: short(21)}),
        **metadata.picture, **metadata.colour,
    }  # fmt: skip
    _write(path, picture, tags, metadata.exif, lambda rows: np.clip(rows * (WHITE - BLACK) + BLACK, 0, 65535))


def _write(
    path: Path, picture: Linear, tags: Mapping[int, Entry], exif: Mapping[int, Entry],
    scaled: Callable[[Linear], Linear],
) -> None:  # fmt: skip
    channels, rows, columns = picture.shape
    tops = range(0, rows, STRIP_ROWS)
    sizes = [2 * channels * columns * min(STRIP_ROWS, rows - top) for top in tops]
    every = {
        **tags, 256: long(columns), 257: long(rows), 258: short(*[16] * channels), 259: short(1),
        277: short(channels), 278: long(STRIP_ROWS), 279: long(*sizes), 284: short(1), 305: text("calibration-station"),
    }  # fmt: skip
    with open(path, "wb") as file:
        file.write(head(every, exif, sizes))
        for top in tops:
            strip = np.moveaxis(picture[:, top : top + STRIP_ROWS], 0, -1)
            file.write(np.ascontiguousarray(np.rint(scaled(strip)).astype("<u2")).tobytes())
