"""A photograph in Alpaca's form: the sensor's numbers, columns first, as JSON or as bytes (ImageBytes, version 1)."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.interfaces import FrameFormat
from procedures.raw import Plane
from station.bench.opening import frame_format

Mosaic = npt.NDArray[np.uint16]
BYTES = "application/imagebytes"
HEADER = struct.Struct("<11i")
INT32, UINT16 = 2, 8
"""Element types of the standard: of the numbers, and of their transmission."""


@dataclass(frozen=True)
class SensorImage:
    """The numbers of a full sensor (rows, columns), its white level, and its first red pixel (x, y).

    `red` is None for a monochrome sensor.
    """

    levels: Mosaic
    white: int
    red: tuple[int, int] | None


def sensor_image(planes: Sequence[Plane]) -> SensorImage:
    """Reassemble the planes of a photograph to the sensor's mosaic."""
    form = frame_format(planes)
    mosaic = np.zeros((form.rows, form.columns), np.uint16)
    for plane in planes:
        x, y = plane.origin
        mosaic[y :: plane.pitch, x :: plane.pitch] = _levels(plane)
    return SensorImage(mosaic, form.white, first_red(form))


def first_red(form: FrameFormat) -> tuple[int, int] | None:
    """The first red pixel (x, y); None for a monochrome sensor."""
    if form.cfa is None:
        return None
    y, x = divmod(form.cfa.index("R"), 2)
    return x, y


def _levels(plane: Plane) -> Mosaic:
    """The digital numbers of a plane."""
    scaled = plane.samples.astype(np.float64) * (plane.white - plane.black) + plane.black
    return np.clip(np.rint(scaled), 0, np.iinfo(np.uint16).max).astype(np.uint16)


def nested(levels: Mosaic) -> list[list[int]]:
    """The numbers as nested lists, by column."""
    columns: list[list[int]] = levels.T.tolist()
    return columns


def image_bytes(levels: Mosaic, client: int, server: int) -> bytes:
    """The numbers as bytes: a header of eleven words, then column by column, two bytes each."""
    rows, columns = levels.shape
    head = HEADER.pack(1, 0, _signed(client), _signed(server), HEADER.size, INT32, UINT16, 2, columns, rows, 0)
    return head + np.ascontiguousarray(levels.T, dtype="<u2").tobytes()


def _signed(number: int) -> int:
    """Reinterpret 32 bits as a signed integer."""
    return number - 2**32 if number >= 2**31 else number
