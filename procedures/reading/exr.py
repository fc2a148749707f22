"""OpenEXR pictures: selected channels of the first part, within the limit of memory, and pictures to write."""

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.reading.guard import Room, decoding, open_file

BYTES = 4  # greatest size of a sample in memory: OpenEXR has half and single precision and 32 bit integers
MOST_CHANNELS = 1024


def read_exr(path: Path, wanted: Container[str] | None = None) -> tuple[dict[str, npt.NDArray[Any]], list[str]]:
    """Read the wanted channels (None: all), each (rows, columns), and the names of all in the first part.

    Raises BadInput if the package OpenEXR is missing, the file is not a picture in scan lines or tiles, or it is too
    large.
    """
    OpenEXR = _library(path)
    open_file(path, "picture").close()
    with decoding(str(path), "an OpenEXR picture", "write it again"):
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            room = Room(str(path))
            for part in file.parts:  # the library decodes all of them
                _check_part(part.header, room)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            pixels = {name: np.array(channels[name].pixels) for name in channels if wanted is None or name in wanted}
            return pixels, sorted(channels)


def write_exr(path: Path, layers: Mapping[str, npt.NDArray[np.floating]]) -> None:
    """Write pictures (rows, columns, 3) in single precision as layers; that of the name "" has no prefix.

    Raises BadInput if the package OpenEXR is missing.
    """
    OpenEXR = _library(path)
    channels = {
        f"{layer}.{colour}".lstrip("."): np.ascontiguousarray(picture[..., i], np.float32)
        for layer, picture in layers.items()
        for i, colour in enumerate("RGB")
    }
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def _library(path: Path) -> Any:
    try:
        import OpenEXR
    except ImportError as error:
        raise BadInput(f"{path} requires the package OpenEXR", "pip install 'calibration-station[exr]'") from error
    return OpenEXR


def _check_part(header: Mapping[str, Any], room: Room) -> None:
    """Raise BadInput if a part is too large, ValueError if it is not a plain picture."""
    if "deep" in str(header["type"]):
        raise ValueError("it has deep data, which are not supported")
    (left, top), (right, bottom) = ([int(v) for v in corner] for corner in header["dataWindow"])
    columns, rows, channels = right - left + 1, bottom - top + 1, len(header["channels"])
    if min(columns, rows, channels) < 1 or channels > MOST_CHANNELS:
        raise ValueError(f"it declares {columns} x {rows} samples of {channels} channels")
    tile = header.get("tiles")
    wide, high = (int(getattr(tile, name, 1)) for name in ("xSize", "ySize"))
    room.take(
        BYTES * channels * max(columns, wide) * max(rows, high), f"{columns} x {rows} samples of {channels} channels"
    )
