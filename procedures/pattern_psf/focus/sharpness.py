"""Sharpness of one photograph after the other, fast enough to guide the focus ring.

The PSF is estimated at given s and k from the part of the frame around the chart. The chart is searched for at its last
position first, then in the whole frame.
"""

from dataclasses import dataclass, replace

import numpy as np

from procedures.choice import START_K, START_S
from procedures.outcome import Outcome, Quantity, Refused, Verdict
from procedures.pattern import Chart
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_chart, find_charts
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf
from procedures.raw import Plane

REACH = 0.9
"""Half the side of the part around the chart over the width of its noise region: its frame, and a margin for motion."""
QUICK = PatternParameters(START_S, START_K, chosen=True)  # default sampling of the PSF


@dataclass(frozen=True)
class Sharpness:
    """Sharpness of a photograph of the chart.

    mtf50 : mean over all directions, in cycles per pixel of the plane
    along_rows, along_columns : MTF50 of detail that varies along the rows (vertical lines) and along the columns
    s_over_t : sampling ratio of the chart; 1 is ideal
    sighting : where the chart was, in pixels of the plane
    """

    mtf50: Quantity
    along_rows: Quantity
    along_columns: Quantity
    s_over_t: float
    sighting: ChartSighting

    @property
    def astigmatism(self) -> tuple[float, float]:
        """MTF50 along the rows minus that along the columns, and its uncertainty if both are independent."""
        one, two = self.along_rows, self.along_columns
        return one.value - two.value, float(np.hypot(one.uncertainty, two.uncertainty))


def measure_sharpness(
    plane: Plane, chart: Chart, parameters: PatternParameters = QUICK, near: ChartSighting | None = None
) -> Outcome[Sharpness]:
    """Measure the sharpness of a plane that shows the chart; the verdict is that of its PSF.

    chart : the cells that were printed
    parameters : s and k must be given: choosing them takes many estimates
    near : position of the chart in the previous photograph
    """
    try:
        sighting = _find_near(plane, near) or find_chart(plane.samples)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    x, y, part = _crop(plane, sighting)
    outcome = estimate_psf(part, chart, parameters, None, sighting.moved(-x, -y))
    if outcome.value is None:
        return outcome.of_value(None)
    numbers = outcome.value.quality.numbers
    radial, rows, columns = (numbers.get(f"mtf50_{way}") for way in ("radial", "horizontal", "vertical"))
    if radial is None or rows is None or columns is None:
        reason = f"the MTF must fall below 0.5 within the band of s = {outcome.value.psf.s}; it does not"
        return Outcome(None, Verdict.REFUSED, reason, "raise s")
    return outcome.of_value(Sharpness(radial, rows, columns, outcome.value.s_over_t, sighting))


def _find_near(plane: Plane, near: ChartSighting | None) -> ChartSighting | None:
    """The chart near its last position; None where there is none, or more than one."""
    if near is None:
        return None
    x, y, part = _crop(plane, near)
    sightings = find_charts(part.samples) if min(part.samples.shape) > 0 else []
    return sightings[0].moved(x, y) if len(sightings) == 1 else None


def _crop(plane: Plane, sighting: ChartSighting) -> tuple[int, int, Plane]:
    """First pixel (x, y) of the part of a plane around a chart, and that part."""
    half = REACH * float(sighting.widths().max())
    (x, y), (rows, columns) = sighting.centre(), plane.samples.shape
    left, right = (int(np.clip(round(x + side), 0, columns)) for side in (-half, half))
    top, bottom = (int(np.clip(round(y + side), 0, rows)) for side in (-half, half))
    return left, top, replace(plane, samples=np.ascontiguousarray(plane.samples[top:bottom, left:right]))
