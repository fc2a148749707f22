"""From how far to photograph a chart of some size: the distance at which s/t is 1.

With t cells of the pattern per pixel of a plane, t = 256 / pixels for a noise region `pixels` wide, so that
s/t = s pixels / 256. At 1 the chart is as fine as the samples of the PSF; `procedures.pattern` has what is best
and what is good.
"""

from __future__ import annotations

from dataclasses import dataclass

from procedures.pattern import CELLS

FOCAL_LENGTHS_MM = (16, 24, 35, 50, 85, 100, 135, 200)
SAMPLES_PER_PIXEL = 4
"""The s that the table is for: the station's default."""
PHOTOSITES_PER_PIXEL = 2
"""A colour plane of a Bayer mosaic has every other photosite."""


@dataclass(frozen=True)
class Sensor:
    """A common sensor: its format, megapixels, and the distance of its photosites in µm."""

    format: str
    megapixels: int
    pitch_um: float

    @property
    def plane_pitch_um(self) -> float:
        """Distance of the pixels of a colour plane."""
        return PHOTOSITES_PER_PIXEL * self.pitch_um


SENSORS = (
    Sensor("1-inch", 20, 2.4),
    Sensor("4/3", 20, 3.3),
    Sensor("APS-C", 24, 3.9),
    Sensor("35 mm", 45, 4.4),
    Sensor("35 mm", 24, 6.0),
)


def ideal_pixels(s: int = SAMPLES_PER_PIXEL) -> float:
    """Width of the noise region, in pixels of a plane, where s/t = 1."""
    return CELLS / s


def distance_mm(focal_mm: float, noise_mm: float, pixels: float, plane_pitch_um: float) -> float:
    """Distance in mm at which noise of `noise_mm` is `pixels` wide in a plane; it must be far over the focal length."""
    return focal_mm * noise_mm / (pixels * plane_pitch_um / 1000)


def table_m(noise_mm: float) -> list[list[float]]:
    """Distances in m for s/t = 1: a row for each focal length, a column for each sensor."""
    pixels = ideal_pixels()
    return [
        [distance_mm(focal, noise_mm, pixels, sensor.plane_pitch_um) / 1000 for sensor in SENSORS]
        for focal in FOCAL_LENGTHS_MM
    ]
