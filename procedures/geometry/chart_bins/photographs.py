"""From a plane of a photograph to a view: where the chart's bins are seen, in sensor pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import ceil

import numpy as np
import numpy.typing as npt

from procedures.geometry.chart_bins.large_chart import reduced, refine_bins
from procedures.geometry.views import ChartView
from procedures.outcome import Outcome, Refused, Verdict
from procedures.pattern import CELLS, Chart
from procedures.pattern_psf.chart_finding.detection import ChartSighting, check_usable, find_charts, one_chart
from procedures.pattern_psf.correspondences import Correspondences
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf, finest
from procedures.raw import Plane, PlaneLike, as_plane

Array = npt.NDArray[np.float64]

SAMPLES = 4
"""Of the PSF per pixel at most: what the geometry is worth does not grow with more."""
WIDE, AVERAGED = 280.0, 200.0
"""Pixels of a plane: a chart wider than the first is averaged down to the second first. There the bins are found to a
tenth of a pixel, from where all pixels tell their places; an estimate half as wide again takes twice as long."""
REACH_PX = 4
"""Side of the PSF's support, in pixels."""


def view_of(plane: PlaneLike, chart: Chart, source: str, sighting: ChartSighting | None = None) -> Outcome[ChartView]:
    """Where a photograph shows the chart, or the reason why it tells nothing.

    Parameters
    ----------
    plane : Plane, or (rows, columns) array
        Linear samples; the one chart may lie anywhere in it, 60 pixels wide or as large as the frame.
    chart : Chart
        The cells that were printed.
    source : str
        What the view is called.
    sighting : ChartSighting, optional
        Where the chart is, as another plane of the photograph tells (`one_chart`, `ChartSighting.moved`); None: it is
        found.

    Raises
    ------
    Refused
        If there is no chart in it, or one that cannot be used.
    """
    plane = as_plane(plane)
    sighting = sighting or one_chart(find_charts(plane.samples))
    width = float(sighting.widths().max())
    factor = 1 if width <= WIDE else ceil(width / AVERAGED)
    small = plane if factor == 1 else replace(plane, samples=reduced(plane.samples, factor))
    sighting = sighting.reduced(factor)
    check_usable(sighting, small.samples.shape)
    found = estimate_psf(small, chart, _parameters(sighting), sighting=sighting)
    if found.value is None:
        return found.of_value(None)
    seen = found.value.correspondences
    if factor == 1:
        return found.of_value(on_sensor(seen, plane, source))
    seen = refine_bins(plane.samples, chart, found.value.registration, seen, factor)
    return Outcome(on_sensor(seen, plane, source))  # what the small picture's PSF is doubted for is not the geometry's


def views_of(planes: Mapping[str, Plane], chart: Chart, source: str) -> dict[str, Outcome[ChartView]]:
    """Where the planes of one photograph show the chart, by their names; it is looked for in one of them, G1 if it can.

    A plane of which `view_of` tells nothing is refused, and does not keep the others.
    """
    guide = planes.get("G1", next(iter(planes.values())))
    try:
        sighting = one_chart(find_charts(guide.samples))
    except Refused as refusal:
        return dict.fromkeys(planes, _refused(refusal))
    found = {}
    for name, plane in planes.items():
        x, y = ((a - b) / plane.pitch for a, b in zip(guide.origin, plane.origin, strict=True))
        try:
            found[name] = view_of(plane, chart, source, sighting.moved(x, y))
        except Refused as refusal:
            found[name] = _refused(refusal)
    return found


def _refused(refusal: Refused) -> Outcome[ChartView]:
    return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)


def _parameters(sighting: ChartSighting) -> PatternParameters:
    """How finely the PSF is sampled: as the cells allow, without looking for the best."""
    s = min(SAMPLES, finest(float(sighting.widths().mean()) / CELLS))
    return PatternParameters(s, REACH_PX * s + 1, chosen=True)


def on_sensor(seen: Correspondences, plane: Plane, source: str) -> ChartView:
    """The view of a plane's correspondences, in sensor pixels."""
    points = plane.pitch * seen.points + np.array(plane.origin, dtype=np.float64)
    return ChartView(source, seen.index, points, plane.pitch**2 * seen.covariance)
