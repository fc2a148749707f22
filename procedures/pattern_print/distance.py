"""Distance at which a chart of some size has the sampling ratio s/t = 1.

t is the number of cells per pixel of a plane, t = 256 / pixels for a noise region `pixels` wide, so s/t is
s pixels / 256. At 1 a cell is as wide as a sample of the PSF; `procedures.pattern` has the recommended ranges.
"""

from dataclasses import dataclass

from procedures.pattern import CELLS
from procedures.pattern_print.panel import Drawing, PrintedLine, Text

FOCAL_LENGTHS_MM = (16, 24, 35, 50, 85, 100, 135, 200)
SAMPLES_PER_PIXEL = 4  # value of s in the table, the default
IDEAL_PIXELS = CELLS / SAMPLES_PER_PIXEL  # width of the noise region, in pixels of a plane, where s/t = 1
PHOTOSITES_PER_PIXEL = 2  # a colour plane of a Bayer mosaic has every other photosite


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
    """Distances in m for s/t = 1, by focal length and sensor; valid far beyond the focal length."""
    widths_um = [IDEAL_PIXELS * PHOTOSITES_PER_PIXEL * sensor.pitch_um for sensor in SENSORS]
    return [[focal * noise_mm / width for width in widths_um] for focal in FOCAL_LENGTHS_MM]


# --- two rulers for checking the printed scale, across and along the paper -------------------------------------------

LENGTH_MM = 100
THICKNESS_MM = 0.12
DIGITS_MM = 2.6


def rulers(x: float, y: float) -> Drawing:
    """Rulers of 100 mm from a common zero at (x, y), to the right and upwards, with ticks and numbers outside."""
    strokes = [
        PrintedLine((x, y), (x + LENGTH_MM, y), THICKNESS_MM),
        PrintedLine((x, y), (x, y - LENGTH_MM), THICKNESS_MM),
    ]
    texts = []
    for mm in range(LENGTH_MM + 1):
        tick = 3.0 if mm % 10 == 0 else 2.2 if mm % 5 == 0 else 1.4
        strokes.append(PrintedLine((x + mm, y), (x + mm, y + tick), THICKNESS_MM))
        strokes.append(PrintedLine((x, y - mm), (x - tick, y - mm), THICKNESS_MM))
        if mm % 10 == 0:
            words = f"{mm} mm" if mm == LENGTH_MM else f"{mm}"
            texts.append(Text(x + mm, y + tick + 2.6, words, DIGITS_MM, anchor="middle"))
            texts.append(Text(x - tick - 0.7, y - mm + 0.9, f"{mm}", DIGITS_MM, anchor="end"))
    return Drawing(tuple(strokes), tuple(texts))
