"""The page of a geometry: the camera's numbers, how well the frame is known, what is left over, chart and views."""

from __future__ import annotations

import numpy as np

from procedures.geometry.cameras import distortion
from procedures.geometry.estimate import Geometry
from procedures.geometry.next_view import next_view_words
from procedures.outcome import Outcome
from station.calibration.geometry import GeometryPhotographs
from station.common.versions import software
from station.reports import geometry_figures as figures
from station.reports.page import render
from station.results.record_head import RecordHead

PAIRS = "grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr))"
RESIDUALS_SHOWN = 6
"""Views whose residuals are drawn: those that leave most."""


def geometry_page(shoot: GeometryPhotographs, outcome: Outcome[Geometry], head: RecordHead) -> str:
    """The page of a camera that was found; raises ValueError where there is none."""
    found = outcome.value
    if found is None:
        raise ValueError("a refused geometry has no page")
    places = found.camera.frame_grid(*figures.ARROWS)
    moved = distortion(found.camera, places)
    known = np.isfinite(moved).all(axis=1)
    worst = sorted(range(len(found.views)), key=lambda i: -found.views[i].rms_px)[:RESIDUALS_SHOWN]
    return render(
        "geometry.html",
        outcome=outcome,
        found=found,
        plane=shoot.plane,
        missed=shoot.missed,
        next_view=next_view_words(found.next_view) if found.next_view else "",
        head=head,
        pairs=PAIRS,
        coverage=figures.coverage_figure(found),
        uncertainties=[
            (_far(one.distance_mm), figures.uncertainty_figure(found, one, i)) for i, one in enumerate(found.maps)
        ],
        drawn_distortion=figures.distortion_figure(found, places[known], moved[known]),
        misfit=figures.misfit_figure(found),
        chart=figures.chart_figure(found),
        residuals=[(found.views[i], figures.residual_figure(found, found.views[i], i)) for i in sorted(worst)],
        software=software(),
    )


def _far(distance_mm: float) -> str:
    return f"{distance_mm:.0f} mm away" if np.isfinite(distance_mm) else "at infinity"
