"""Distance at which a chart of some size has the sampling ratio s/t = 1.

t is the number of cells per pixel of a plane, t = 256 / pixels for a noise region `pixels` wide, so s/t is
s pixels / 256. At 1 a cell is as wide as a sample of the PSF; `procedures.pattern` has the recommended ranges.
"""

from __future__ import annotations

from dataclasses import dataclass

from procedures.pattern import CELLS

FOCAL_LENGTHS_MM = (16, 24, 35, 50, 85, 100, 135, 200)
SAMPLES_PER_PIXEL = 4
"""Value of s in the table, the default."""
IDEAL_PIXELS = CELLS / SAMPLES_PER_PIXEL
"""Width of the noise region, in pixels of a plane, where s/t = 1."""
PHOTOSITES_PER_PIXEL = 2
"""A colour plane of a Bayer mosaic has every other photosite."""


@dataclass(frozen=True)
class SensorFormat:
    """A common sensor: its format, megapixels, and pixel pitch in µm."""

    format: str
    megapixels: int
    pitch_um: float


SENSORS = (
    SensorFormat("1-inch", 20, 2.4),
    SensorFormat("4/3", 20, 3.3),
    SensorFormat("APS-C", 24, 3.9),
    SensorFormat("35 mm", 45, 4.4),
    SensorFormat("35 mm", 24, 6.0),
)


def table_m(noise_mm: float) -> list[list[float]]:
    """Distances in m for s/t = 1: a row for each focal length, a column for each sensor.

    Valid far beyond the focal length.
    """
    widths_um = [IDEAL_PIXELS * PHOTOSITES_PER_PIXEL * sensor.pitch_um for sensor in SENSORS]
    return [[focal * noise_mm / width for width in widths_um] for focal in FOCAL_LENGTHS_MM]
