"""Photographs with red, green and blue on one grid: RGB files of 16 bits, linear or sRGB."""

from __future__ import annotations

import hashlib
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from procedures.raw import Plane, RawFrame, read_photograph
from procedures.reading.exposure import read_exposure
from procedures.reading.grey_image import read_colours


def read_colour_frame(path: Path | str, encoding: str, *, data: bytes | None = None) -> RawFrame:
    """Planes R, G, B of a TIFF or PNG of 16 bits; encoding "linear" or "srgb" (IEC 61966-2-1, inverted). Raises
    BadInput if it is not such a file."""
    path = Path(path)
    data = read_photograph(path) if data is None else data
    levels = read_colours(data, str(path)).astype(np.float32) / np.float32(65535)
    light = levels if encoding == "linear" else _linear(levels)
    planes = {name: Plane(name, np.ascontiguousarray(light[..., c]), 1 / 65535) for c, name in enumerate("RGB")}
    return RawFrame(path, hashlib.sha256(data).hexdigest(), planes, read_exposure(BytesIO(data)))


def _linear(levels: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Inverse of sRGB's transfer function."""
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return np.asarray(light, dtype=np.float32)
