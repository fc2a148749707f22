"""Pictures as files: colour planes as image channels, 8-bit levels, false colours, PNG in sRGB, float32 TIFF."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating[Any]]
Levels = npt.NDArray[np.uint8]
IMAGE_DESCRIPTION, ASCII = 270, 2


def picture(sharp: Array) -> Array:
    """Planes (C, H, W) as OpenCV's image: (H, W), or (H, W, 3) as blue, green, red of RAW planes."""
    if len(sharp) == 1:
        return np.asarray(sharp[0])
    red, blue = sharp[0], sharp[-1]
    return np.stack([blue, sharp[1:-1].mean(axis=0), red], axis=-1)


def levels(image: Array, black: float, white: float) -> Levels:
    """8-bit levels of an image between two values."""
    return np.asarray(np.clip((image - black) / max(white - black, 1e-12) * 255 + 0.5, 0, 255), dtype=np.uint8)


def false_colours(image: Levels) -> Levels:
    """8-bit levels in false colours."""
    import cv2

    return np.asarray(cv2.applyColorMap(image, cv2.COLORMAP_VIRIDIS), dtype=np.uint8)


def encoded(kind: str, image: npt.NDArray[Any]) -> bytes:
    """The bytes of an image file; colours in OpenCV's order, blue first."""
    import cv2

    done, data = cv2.imencode(kind, image)
    if not done:
        raise RuntimeError(f"OpenCV could not encode {kind}")
    return data.tobytes()


def float_tiff(image: Array) -> bytes:
    """A float32 TIFF of linear (rows, columns) or (rows, columns, 3), 1 = white."""
    return encoded(".tiff", _blue_first(image.astype(np.float32)))


def display_png(image: Array) -> bytes:
    """A PNG of a linear image for a screen: clipped to [0, 1], with the transfer curve of sRGB (IEC 61966-2-1)."""
    light = np.clip(image.astype(np.float64), 0.0, 1.0)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return encoded(".png", _blue_first(np.rint(255 * curve).astype(np.uint8)))


def _blue_first(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image)


def described_tiff(tiff: bytes, description: str) -> bytes:
    """A little-endian TIFF with an ImageDescription, its directory repeated at the end (TIFF 6.0, sections 2, 8)."""
    if tiff[:4] != b"II*\0":
        raise ValueError("a little-endian TIFF is required; got another file")
    (at,) = struct.unpack_from("<I", tiff, 4)
    (count,) = struct.unpack_from("<H", tiff, at)
    entries = [tiff[at + 2 + 12 * i : at + 14 + 12 * i] for i in range(count)]
    text = description.encode("ascii", "replace") + b"\0"
    tiff += b"\0" * (len(tiff) % 2)
    entries.append(struct.pack("<HHII", IMAGE_DESCRIPTION, ASCII, len(text), len(tiff)))
    body = tiff + text + b"\0" * (len(text) % 2)
    entries.sort(key=lambda entry: struct.unpack_from("<H", entry)[0])
    directory = struct.pack("<H", len(entries)) + b"".join(entries) + bytes(4)
    return body[:4] + struct.pack("<I", len(body)) + body[8:] + directory
