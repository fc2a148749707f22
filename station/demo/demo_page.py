"""The demonstration's page: estimates next to the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from procedures.numbers import Group, in_group
from procedures.pattern_print.sheet import Size
from simulators.bench.demonstration import WIDTH_MM
from station.common.versions import software
from station.reports import otf_figures, psf_figures
from station.reports.page import exposure_words, render
from station.reports.psf_page import chart_figures, edge_rows

if TYPE_CHECKING:
    from station.demo.demonstration import Demonstration, DemoPhotograph, Summary
    from station.demo.truth_comparison import TruthComparison

SHOWN_PLANE = "G1"
"""Plane whose photograph and residual are drawn."""


def demonstration_page(demonstration: Demonstration, summary: Summary) -> str:
    """The demonstration's report."""
    return render(
        "demo.html",
        found=demonstration,
        summary=summary,
        size=Size(WIDTH_MM),
        compared=[
            psf_figures.ratios_figure(_compared(demonstration, lambda one: [one.ratio]), "ratios"),
            psf_figures.sigmas_figure(
                _compared(demonstration, lambda one: [against.sigmas for against in one.mtf50.values()]), "sigmas"
            ),
            psf_figures.places_figure(_places(demonstration), "places"),
        ],
        titles=in_group(Group.HEADLINE),
        edge_rows=edge_rows,
        pictures={shot.setup.name: _pictures(shot, f"p{i}") for i, shot in enumerate(demonstration.shots, 1)},
        exposure=exposure_words,
        software=software(),
    )


def _compared(demonstration: Demonstration, numbers: Callable[[TruthComparison], Sequence[float]]) -> psf_figures.Rows:
    """Numbers of every compared plane, by photograph."""
    return [
        (shot.setup.title, {one.name: numbers(one.comparison) for one in shot.planes if one.comparison is not None})
        for shot in demonstration.shots
    ]


def _places(demonstration: Demonstration) -> list[Any]:
    """Outlines of the charts in fractions of the frame."""
    outlines = []
    for shot in demonstration.shots:
        for plane in shot.planes[:1]:
            if plane.result.found is not None:
                rows, columns = shot.frame.planes[plane.name].samples.shape
                outlines.append(psf_figures.chart_outline(plane.result.found) / (columns, rows))
    return outlines


def _pictures(shot: DemoPhotograph, name: str) -> Mapping[str, Any]:
    """Figures of one photograph: of its shown plane, and of every plane."""
    pictures: dict[str, Any] = {"planes": {}}
    for plane in shot.planes:
        estimate, against = plane.result.found, plane.comparison
        if estimate is None or against is None:
            continue
        here = f"{name}-{plane.name}"
        pictures["planes"][plane.name] = {
            "psf": psf_figures.psf_figure(estimate.psf, against.aligned, f"{here}-psf"),
            "mtf": otf_figures.mtf_figure(estimate.quality, against.otf, f"{here}-mtf", estimate.diffraction),
        }
        if plane.name == SHOWN_PLANE:
            pictures["chart"] = chart_figures(shot.frame.planes[plane.name], estimate, here)
    return pictures
