"""Photographs become arrays here: mosaic planes of RAW files, grey images; nothing is demosaicked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Exposure:
    """What the camera wrote about a shot; None where it wrote nothing. `sources` tells where each field came from."""

    camera: str | None = None
    lens: str | None = None
    exposure_s: float | None = None
    f_number: float | None = None
    iso: float | None = None
    focal_length_mm: float | None = None
    subject_distance_mm: float | None = None
    captured_at: str | None = None
    sources: Mapping[str, str] | None = None


@dataclass(frozen=True)
class Plane:
    """One linear colour plane of a photograph.

    Attributes
    ----------
    name : str
        "R", "G1", "G2", "B" of a mosaic (G1 on the red rows), "Y" of a grey image.
    samples : (rows, columns) float32
        Black level subtracted, scaled so that white is 1; values below black stay negative.
    quantisation : float
        One step of the digital numbers, in units of `samples`.
    pitch : int
        Sensor pixels per pixel of the plane: 2 for a Bayer plane, 1 for a grey image.
    origin : (int, int)
        Sensor position (x, y) of the plane's first pixel.
    """

    name: str
    samples: npt.NDArray[np.float32]
    quantisation: float
    pitch: int = 1
    origin: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class RawFrame:
    """A photograph as read: its planes by name, in the order of the mosaic, and where it came from."""

    path: Path
    sha256: str
    planes: Mapping[str, Plane]
    exposure: Exposure
