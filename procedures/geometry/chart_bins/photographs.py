"""Views from planes of photographs: positions of the chart's bins, in sensor pixels."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from procedures.geometry.chart_bins.large_chart import reduced, refine_bins
from procedures.geometry.chart_bins.turned_view import TurnedView, find_turned, joined, quarters
from procedures.geometry.views import ChartView
from procedures.numerics.arrays import Array32
from procedures.outcome import Outcome, Refused, Verdict, with_refusal
from procedures.pattern import CELLS, Chart
from procedures.pattern_psf.chart_finding.detection import ChartSighting, check_usable, find_charts, one_chart
from procedures.pattern_psf.correspondences import Correspondences
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf, finest, locate_bins
from procedures.raw import Plane, PlaneLike, as_plane

MAX_SAMPLES = 4  # samples of the PSF per pixel: the geometry does not improve with more
WIDE_PX, REDUCED_PX = 280.0, 200.0
"""In pixels of a plane: a chart wider than the first is reduced to at most the second. There the bins are located to
a tenth of a pixel and then refined in all pixels; an estimate at 1.5 times the width takes twice as long."""
SUPPORT_PX = 4  # side of the PSF's support, in pixels


@dataclass(frozen=True, eq=False)
class ChartLocation:
    """The chart in a plane, or in its picture by a turned camera."""

    sighting: ChartSighting
    turned: TurnedView | None = None

    def moved(self, x: float, y: float) -> "ChartLocation":
        """The chart in a plane whose content is shifted by (x, y) pixels."""
        if self.turned is None:
            return replace(self, sighting=self.sighting.moved(x, y))
        return replace(self, turned=self.turned.moved(x, y))


def locate_chart(samples: Array32) -> ChartLocation:
    """The chart in a plane: with all its marks on straight lines, or as a camera turned towards it shows it.

    Raises Refused if there is no chart in it, or more than one.
    """
    charts = find_charts(samples)
    if charts and (len(charts) > 1 or charts[0].visible.all()):
        return ChartLocation(one_chart(charts))
    turned = find_turned(samples, REDUCED_PX, charts[0] if charts else None)
    if turned is not None and not (charts and turned[0].visible.sum() <= charts[0].visible.sum()):
        return ChartLocation(*turned)
    return ChartLocation(one_chart(charts))


@with_refusal
def view_of(plane: PlaneLike, chart: Chart, source: str, location: ChartLocation | None = None) -> Outcome[ChartView]:
    """The view of the chart in a photograph, or the reason why it gives none.

    plane : Plane, or (rows, columns) array
        Linear samples; the chart may lie anywhere in it, from 60 pixels wide to the size of the frame.
    chart : Chart, the printed cells
    source : str, name of the view
    location : SeenChart, the chart in another plane, moved to this one; None: it is searched for
    """
    plane = as_plane(plane)
    location = location or locate_chart(plane.samples)
    sighting, turned = location.sighting, location.turned
    width = float(sighting.widths().max())
    factor = ceil(width / REDUCED_PX) if turned is None and width > WIDE_PX else 1
    samples = reduced(plane.samples, factor) if turned is None else turned.picture(plane.samples)
    sighting = sighting.reduced(factor)
    check_usable(sighting, samples.shape)
    s = min(MAX_SAMPLES, finest(float(sighting.widths().mean()) / CELLS))
    parameters = PatternParameters(s, SUPPORT_PX * s + 1, chosen=True)
    if turned is None and factor == 1:
        psf = estimate_psf(plane, chart, parameters, sighting=sighting)
        return psf.of_value(None if psf.value is None else on_sensor(psf.value.correspondences, plane, source))
    # flags of the PSF of a picture that was reduced or turned do not concern the geometry
    located = locate_bins(replace(plane, samples=samples), chart, parameters, sighting)
    if located.value is None:
        return located.of_value(None)
    registration, bins = located.value
    if turned is not None:
        parts = [turned.registered(part) for part in quarters(bins)]
        bins = joined([refine_bins(plane.samples, chart, *part, turned.factor) for part in parts])
    else:
        bins = refine_bins(plane.samples, chart, registration, bins, factor)
    return Outcome(on_sensor(bins, plane, source))


def views_of(planes: Mapping[str, Plane], chart: Chart, source: str) -> dict[str, Outcome[ChartView]]:
    """The view of the chart in every plane of a photograph, by name; the chart is searched for in one plane, G1 if any.

    A plane for which `view_of` fails is refused, the others are not affected.
    """
    guide = planes.get("G1", next(iter(planes.values())))
    try:
        location = locate_chart(guide.samples)
    except Refused as refusal:
        return dict.fromkeys(planes, Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy))
    views = {}
    for name, plane in planes.items():
        x, y = ((a - b) / plane.pitch for a, b in zip(guide.origin, plane.origin, strict=True))
        views[name] = view_of(plane, chart, source, location.moved(x, y))
    return views


def on_sensor(bins: Correspondences, plane: Plane, source: str) -> ChartView:
    """The view of a plane's correspondences, in sensor pixels."""
    points = plane.pitch * bins.points + np.array(plane.origin, dtype=np.float64)
    return ChartView(source, bins.index, points, plane.pitch**2 * bins.covariance)
