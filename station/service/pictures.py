"""The newest photograph as a picture for a browser."""

import threading
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from procedures.raw import Plane

LONGEST_SIDE = 800
LEAST_WHITE = 0.05
"""Lower limit of the white level: a frame with the lens cap on must not look like a picture."""
GAMMA = 2.2
QUALITY = 85


@dataclass(frozen=True)
class JpegPicture:
    """A JPEG file, its number since the start of the program, and its caption."""

    number: int
    jpeg: bytes
    caption: str


class LatestPicture:
    """The newest frame; encoded on request."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._plane: Plane | None = None
        self._encoded: JpegPicture | None = None
        self.number = 0

    def show(self, plane: Plane) -> None:
        """Set the newest frame. From any thread; returns at once."""
        with self._lock:
            self._plane, self._encoded, self.number = plane, None, self.number + 1

    def take(self) -> JpegPicture | None:
        """The newest picture, None before the first."""
        with self._lock:
            if self._encoded is None and self._plane is not None:
                rows, columns = self._plane.samples.shape
                caption = f"plane {self._plane.name}, {columns} x {rows} pixels"
                self._encoded = JpegPicture(self.number, jpeg_of(self._plane.samples), caption)
            return self._encoded


def jpeg_of(samples: npt.NDArray[np.float32]) -> bytes:
    """A linear plane (rows, columns) as a JPEG, its brightest parts white, no side above LONGEST_SIDE."""
    rows, columns = samples.shape
    scale = min(1.0, LONGEST_SIDE / max(rows, columns))
    size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
    small = cv2.resize(samples, size, interpolation=cv2.INTER_AREA)
    white = max(float(np.percentile(small, 99.5)), LEAST_WHITE)
    levels = np.clip(small / white, 0.0, 1.0) ** (1 / GAMMA) * 255
    _, data = cv2.imencode(".jpg", levels.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(data)
