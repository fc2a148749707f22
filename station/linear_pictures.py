"""Linear colour pictures as files: float32 TIFF for programs, PNG in sRGB for people."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Linear = npt.NDArray[np.floating]


def float_tiff(picture: Linear) -> bytes:
    """A TIFF of (rows, columns) or (rows, columns, 3) as it is, float32, 1 = white."""
    return _encoded(".tiff", picture.astype(np.float32))


def display_png(picture: Linear) -> bytes:
    """A PNG of the same for a screen: clipped to [0, 1], with the transfer curve of sRGB (IEC 61966-2-1)."""
    light = np.clip(picture.astype(np.float64), 0.0, 1.0)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return _encoded(".png", np.rint(255 * curve).astype(np.uint8))


def _encoded(suffix: str, picture: npt.NDArray[np.generic]) -> bytes:
    import cv2

    # OpenCV keeps blue first
    done, data = cv2.imencode(suffix, np.ascontiguousarray(picture[..., ::-1] if picture.ndim == 3 else picture))
    if not done:
        raise RuntimeError(f"OpenCV could not encode a picture as {suffix}")
    return data.tobytes()
