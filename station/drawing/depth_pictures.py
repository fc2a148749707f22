"""Pictures of a restoration for files and pages: colour planes as image channels, levels, depth in false colours."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating[Any]]


def picture(sharp: Array) -> Array:
    """(C, H, W) as an image file holds it: (H, W), or (H, W, 3) as blue, green, red of RAW planes."""
    if len(sharp) == 1:
        return np.asarray(sharp[0])
    red, blue = sharp[0], sharp[-1]
    return np.stack([blue, sharp[1:-1].mean(axis=0), red], axis=-1)


def levels(image: Array, black: float, white: float) -> npt.NDArray[np.uint8]:
    """8-bit levels of an image between two values."""
    return np.asarray(np.clip((image - black) / max(white - black, 1e-12) * 255 + 0.5, 0, 255), dtype=np.uint8)


def coloured(w: Array) -> npt.NDArray[np.uint8]:
    """The depth map in false colours, its least to its greatest w."""
    import cv2

    return np.asarray(
        cv2.applyColorMap(levels(w, float(w.min()), float(w.max())), cv2.COLORMAP_VIRIDIS), dtype=np.uint8
    )


def encoded(kind: str, image: npt.NDArray[Any]) -> bytes:
    """The bytes of an image file."""
    import cv2

    done, data = cv2.imencode(kind, image)
    if not done:
        raise RuntimeError(f"OpenCV could not encode {kind}")
    return data.tobytes()
