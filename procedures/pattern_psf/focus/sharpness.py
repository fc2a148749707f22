"""How sharp one photograph after the other is, soon enough to turn the focus ring by it.

The PSF is estimated as everywhere, at an s and k that are given, from a part of the frame about the chart: it is
looked for where it was seen last, and over the whole frame where it is not there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from procedures.choice import START_K, START_S
from procedures.outcome import Outcome, Quantity, Refused, Verdict
from procedures.pattern import Chart
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_chart, find_charts
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.raw import Plane

REACH = 0.9
"""Half the side of the part about the chart, over the width of its noise region: its rim, and room to have moved."""
QUICK = PatternParameters(START_S, START_K, chosen=True)
"""How the PSF is sampled where nothing else is asked."""


@dataclass(frozen=True)
class Sharpness:
    """What a photograph tells about the focus.

    Attributes
    ----------
    mtf50 : Quantity
        Mean over all directions, in cycles per pixel of the plane.
    along_rows, along_columns : Quantity
        Of detail that repeats along the rows (upright lines) and along the columns.
    s_over_t : float
        Sampling ratio of the chart; 1 is ideal.
    sighting : ChartSighting
        Where the chart was, in pixels of the plane.
    """

    mtf50: Quantity
    along_rows: Quantity
    along_columns: Quantity
    s_over_t: float
    sighting: ChartSighting

    @property
    def astigmatism(self) -> tuple[float, float]:
        """MTF50 along the rows less that along the columns, and its uncertainty as if both were independent."""
        one, two = self.along_rows, self.along_columns
        return one.value - two.value, float(np.hypot(one.uncertainty, two.uncertainty))


def measure_sharpness(
    plane: Plane, chart: Chart, parameters: PatternParameters = QUICK, near: ChartSighting | None = None
) -> Outcome[Sharpness]:
    """The sharpness of a plane that shows the chart, with the verdict on its PSF, or why there is none.

    Parameters
    ----------
    plane : Plane
    chart : Chart
        The cells that were printed.
    parameters : PatternParameters
        s and k must be given: to choose them takes many estimates.
    near : ChartSighting, optional
        Where the chart was in the photograph before.
    """
    try:
        sighting = _seen_near(plane, near) or find_chart(plane.samples)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    x, y, part = _about(plane, sighting)
    found = estimate_psf(part, chart, parameters, None, sighting.moved(-x, -y))
    if found.value is None:
        return found.of_value(None)
    return _sharpness(found, found.value, sighting)


def _sharpness(found: Outcome[PatternPsf], value: PatternPsf, sighting: ChartSighting) -> Outcome[Sharpness]:
    numbers = value.quality.numbers
    told = [numbers.get(f"mtf50_{way}") for way in ("radial", "horizontal", "vertical")]
    radial, rows, columns = told
    if radial is None or rows is None or columns is None:
        reason = "the MTF must fall to one half within the band that s holds; it does not"
        return Outcome(None, Verdict.REFUSED, reason, "give a larger s")
    one = Sharpness(radial, rows, columns, value.s_over_t, sighting)
    return found.of_value(one)


def _seen_near(plane: Plane, near: ChartSighting | None) -> ChartSighting | None:
    """The chart about where it was; None where it is not, or not alone."""
    if near is None:
        return None
    x, y, part = _about(plane, near)
    found = find_charts(part.samples) if min(part.samples.shape) > 0 else []
    return found[0].moved(x, y) if len(found) == 1 else None


def _about(plane: Plane, sighting: ChartSighting) -> tuple[int, int, Plane]:
    """The part of a plane about a chart, and its first pixel (x, y)."""
    half = REACH * float(sighting.widths().max())
    (x, y), (rows, columns) = sighting.centre(), plane.samples.shape
    left, right = (int(np.clip(round(x + side), 0, columns)) for side in (-half, half))
    top, bottom = (int(np.clip(round(y + side), 0, rows)) for side in (-half, half))
    return left, top, replace(plane, samples=np.ascontiguousarray(plane.samples[top:bottom, left:right]))
