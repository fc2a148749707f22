"""The page of a geometry: the camera's numbers, how well the frame is known, what is left over, chart and views."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from procedures.geometry.cameras import distortion
from procedures.geometry.estimate import Geometry
from procedures.geometry.next_view import next_view_words
from station.calibration.geometry import PlaneGeometry
from station.common.versions import software
from station.reports import geometry_figures as figures
from station.reports.page import render
from station.results.record_head import RecordHead

PAIRS = "grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr))"
RESIDUALS_SHOWN = 6
"""Views whose residuals are drawn: those that leave most."""


def geometry_page(planes: Sequence[PlaneGeometry], head: RecordHead) -> str:
    """The page of all planes, with why one has no camera; raises ValueError where all were refused."""
    if all(one.outcome.value is None for one in planes):
        raise ValueError("a refused geometry has no page")
    return render(
        "geometry.html",
        planes=[_of_plane(one, "" if len(planes) == 1 else f"{one.shoot.plane}-") for one in planes],
        head=head,
        pairs=PAIRS,
        software=software(),
    )


def _of_plane(plane: PlaneGeometry, prefix: str) -> dict[str, Any]:
    """What the page shows of a plane; `prefix` keeps its figures' names apart from those of others."""
    shown = {"plane": plane.shoot.plane, "outcome": plane.outcome, "missed": plane.shoot.missed}
    found = plane.outcome.value
    return {**shown, "found": found, **({} if found is None else _figures(found, prefix))}


def _figures(found: Geometry, prefix: str) -> dict[str, Any]:
    places = found.camera.frame_grid(*figures.ARROWS)
    moved = distortion(found.camera, places)
    known = np.isfinite(moved).all(axis=1)
    worst = sorted(range(len(found.views)), key=lambda i: -found.views[i].rms_px)[:RESIDUALS_SHOWN]
    views = [(i, found.views[i]) for i in sorted(worst)]
    return {
        "next_view": next_view_words(found.next_view) if found.next_view else "",
        "coverage": figures.coverage_figure(found, f"{prefix}coverage"),
        "uncertainties": [
            (_far(one.distance_mm), figures.uncertainty_figure(found, one, f"{prefix}uncertainty{i}"))
            for i, one in enumerate(found.maps)
        ],
        "drawn_distortion": figures.distortion_figure(found, places[known], moved[known], f"{prefix}distortion"),
        "misfit": figures.misfit_figure(found, f"{prefix}misfit"),
        "chart": figures.chart_figure(found, f"{prefix}chart"),
        "residuals": [(one, figures.residual_figure(found, one, f"{prefix}residual{i}")) for i, one in views],
    }


def _far(distance_mm: float) -> str:
    return f"{distance_mm:.0f} mm away" if np.isfinite(distance_mm) else "at infinity"
