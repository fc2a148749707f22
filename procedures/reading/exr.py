"""OpenEXR pictures: the channels asked for of the first part, once the headers say that they fit into memory."""

from __future__ import annotations

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.reading.guard import Room, decoding, open_file

BYTES = 4
"""Of a sample in memory, at most: OpenEXR has half and single precision and 32 bit counts."""
MOST_CHANNELS = 1024


def read_exr(path: Path, wanted: Container[str]) -> tuple[dict[str, npt.NDArray[Any]], list[str]]:
    """The wanted channels, each (rows, columns), and the names of all that the first part has.

    Raises
    ------
    BadInput
        If the package OpenEXR is not there, the file is no picture in lines or tiles, or it would take too much memory.
    """
    try:
        import OpenEXR
    except ImportError as error:
        raise BadInput(f"{path} needs the package OpenEXR", "pip install 'calibration-station[exr]'") from error
    open_file(path, "picture").close()
    with decoding(str(path), "an OpenEXR picture", "write it again"):
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            room = Room(str(path))
            for part in file.parts:  # the library decodes all of them
                _check_part(part.header, room)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            found = {name: np.array(channels[name].pixels) for name in channels if name in wanted}
            return found, sorted(channels)


def _check_part(header: Mapping[str, Any], room: Room) -> None:
    """Raise BadInput where a part would take too much memory, ValueError where it is no plain picture."""
    if "deep" in str(header["type"]):
        raise ValueError("it holds deep data: lists of samples in place of numbers")
    (left, top), (right, bottom) = ([int(v) for v in corner] for corner in header["dataWindow"])
    columns, rows, channels = right - left + 1, bottom - top + 1, len(header["channels"])
    if min(columns, rows, channels) < 1 or channels > MOST_CHANNELS:
        raise ValueError(f"it announces {columns} x {rows} samples of {channels} channels")
    tile = header.get("tiles")
    wide, high = (int(getattr(tile, name, 1)) for name in ("xSize", "ySize"))
    room.take(
        BYTES * channels * max(columns, wide) * max(rows, high), f"{columns} x {rows} samples of {channels} channels"
    )
