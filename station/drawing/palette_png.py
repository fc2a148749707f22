"""PNGs with a palette: a picture in false colours has at most 256 and then takes a third of the space."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import numpy.typing as npt

COLOURS = 256


def smaller(png: bytes) -> bytes:
    """The picture with a palette, if it has few enough colours and becomes smaller; else unchanged."""
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 4:
        return png
    flat = np.ascontiguousarray(picture[..., [2, 1, 0, 3]]).view(np.uint32)[..., 0]
    colours, index = np.unique(flat, return_inverse=True)
    if len(colours) > COLOURS:
        return png
    encoded = _encoded(index.reshape(flat.shape).astype(np.uint8), colours.view(np.uint8).reshape(-1, 4))
    return encoded if len(encoded) < len(png) else png


def _encoded(index: npt.NDArray[np.uint8], palette: npt.NDArray[np.uint8]) -> bytes:
    """Source: PNG specification (ISO/IEC 15948), section 11: colour type 3, 8 bits, filter 0."""
    rows, columns = index.shape
    lines = np.concatenate([np.zeros((rows, 1), np.uint8), index], axis=1)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", columns, rows, 8, 3, 0, 0, 0)),
        (b"PLTE", palette[:, :3].tobytes()),
        (b"tRNS", palette[:, 3].tobytes()),
        (b"IDAT", zlib.compress(lines.tobytes(), 9)),
        (b"IEND", b""),
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
