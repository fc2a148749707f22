"""A photograph as Alpaca sends it: the sensor's numbers, columns first, as JSON or as bytes (ImageBytes, version 1)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.raw import GREY_PLANE, Plane

Mosaic = npt.NDArray[np.uint16]
BYTES = "application/imagebytes"
HEADER = struct.Struct("<11i")
INT32, UINT16 = 2, 8
"""Element types of the standard: what the numbers mean, what they are sent as."""


@dataclass(frozen=True)
class SensorImage:
    """The numbers of a whole sensor (rows, columns), its white level, and where its first red pixel lies (x, y).

    `red` is None for a sensor without colours.
    """

    levels: Mosaic
    white: int
    red: tuple[int, int] | None


def sensor_image(planes: Sequence[Plane]) -> SensorImage:
    """The planes of a photograph put together again as the sensor gave them."""
    first = planes[0]
    white = round(first.white)
    if first.name == GREY_PLANE:
        return SensorImage(_levels(first), white, None)
    rows = max(plane.origin[1] + 2 * plane.samples.shape[0] - 1 for plane in planes)
    columns = max(plane.origin[0] + 2 * plane.samples.shape[1] - 1 for plane in planes)
    mosaic = np.zeros((rows, columns), np.uint16)
    for plane in planes:
        x, y = plane.origin
        mosaic[y::2, x::2] = _levels(plane)
    red = next(plane.origin for plane in planes if plane.name == "R")
    return SensorImage(mosaic, white, (red[0] % 2, red[1] % 2))


def _levels(plane: Plane) -> Mosaic:
    """The digital numbers of a plane."""
    scaled = plane.samples.astype(np.float64) * (plane.white - plane.black) + plane.black
    return np.clip(np.rint(scaled), 0, np.iinfo(np.uint16).max).astype(np.uint16)


def nested(levels: Mosaic) -> list[list[int]]:
    """The numbers as JSON's: a list of columns."""
    columns: list[list[int]] = levels.T.tolist()
    return columns


def image_bytes(levels: Mosaic, client: int, server: int) -> bytes:
    """The numbers as bytes: a head of eleven words, then column by column, two bytes each."""
    rows, columns = levels.shape
    head = HEADER.pack(1, 0, _signed(client), _signed(server), HEADER.size, INT32, UINT16, 2, columns, rows, 0)
    return head + np.ascontiguousarray(levels.T, dtype="<u2").tobytes()


def _signed(number: int) -> int:
    """The same 32 bits as a signed word."""
    return number - 2**32 if number >= 2**31 else number
