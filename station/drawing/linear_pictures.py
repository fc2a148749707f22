"""Linear colour pictures as files: float32 TIFF for programs, PNG in sRGB for people."""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

Linear = npt.NDArray[np.floating]
IMAGE_DESCRIPTION, ASCII = 270, 2


def float_tiff(picture: Linear) -> bytes:
    """A TIFF of (rows, columns) or (rows, columns, 3) as it is, float32, 1 = white."""
    return _encoded(".tiff", picture.astype(np.float32))


def display_png(picture: Linear) -> bytes:
    """A PNG of the same for a screen: clipped to [0, 1], with the transfer curve of sRGB (IEC 61966-2-1)."""
    light = np.clip(picture.astype(np.float64), 0.0, 1.0)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return _encoded(".png", np.rint(255 * curve).astype(np.uint8))


def described_tiff(tiff: bytes, description: str) -> bytes:
    """A TIFF of one picture, little-endian, with an ImageDescription: its directory again at the end, one entry longer.

    Source: TIFF 6.0, sections 2 and 8.
    """
    if tiff[:4] != b"II*\0":
        raise ValueError("a little-endian TIFF is described; got another file")
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


def _encoded(suffix: str, picture: npt.NDArray[np.generic]) -> bytes:
    import cv2

    # OpenCV keeps blue first
    done, data = cv2.imencode(suffix, np.ascontiguousarray(picture[..., ::-1] if picture.ndim == 3 else picture))
    if not done:
        raise RuntimeError(f"OpenCV could not encode a picture as {suffix}")
    return data.tobytes()
