"""The page of a photograph's slanted edges: places, spread functions and MTF of every plane, every edge's numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.patches import Rectangle

from procedures.numbers import label
from procedures.numerics.arrays import Array
from procedures.quality import Diffraction
from procedures.raw import Plane
from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome, orientation
from station.calibration.edges import EdgeRecord, PhotographEdges
from station.drawing.colours import MARK
from station.drawing.plots import Figure, curve, finished, picture, pixel_extent, plot_axes
from station.reports.otf_figures import FrequencyAxis, finish_mtf, mtf_caption
from station.reports.page import Block, Figures, Note, Section, Table, quantity, reason_words, render, tag
from station.reports.report import Report
from station.reports.report_page import curves_over, report_page
from station.results.units import convert_numbers

COLOURS = ("#1f5fa8", "#c4541a", "#1e8449", "#6b4c9a", "#8a6d1b", "#444444")
MAX_SIDE_PX = 480


def places_figure(plane: Plane, edges: Sequence[EdgeOutcome], name: str) -> Figure:
    """The photograph with every edge's region and its number."""
    step = max(1, round(max(plane.samples.shape) / MAX_SIDE_PX))
    axes, shown = plot_axes(rim_in=(0.4, 0.1, 0.4, 0.1)), plane.samples[::step, ::step]
    white = float(np.percentile(shown, 99.5))
    picture(axes, shown, extent=pixel_extent(plane.samples.shape), colours="gray", limits=(0, white))
    for number, edge in enumerate(edges, 1):
        if edge.roi is not None:
            x, y = edge.roi.x - 0.5, edge.roi.y - 0.5
            axes.add_patch(Rectangle((x, y), edge.roi.width, edge.roi.height, fill=False, ec=MARK, lw=1))
            axes.annotate(f"{number}", (x, y), (2, -2), textcoords="offset points", va="top", color=MARK)
    axes.locator_params(nbins=5)
    caption = "Where the edges were measured, the best first."
    return finished(axes, name, caption, xlabel=f"pixels of {plane.name}")


def spread_figure(edges: Sequence[tuple[int, EdgeMtf]], name: str) -> Figure:
    """The edge spread functions, each from its dark to its bright side."""
    axes = plot_axes()
    for number, edge in edges:
        axes.plot(edge.distances, edge.esf, ".", ms=1.5, color=COLOURS[(number - 1) % len(COLOURS)])
    caption = "Light over the distance from the edge, from which the MTF is computed."
    return finished(axes, name, caption, xlim=(-8, 8), xlabel="pixels from the edge", ylabel="light, dark to bright")


def edges_mtf_figure(
    edges: Sequence[tuple[int, EdgeMtf]], axis: FrequencyAxis, name: str, limit: Diffraction | None = None,
    others: Mapping[str, Mapping[str, Array]] | None = None, words: str = "the edges",
) -> Figure:  # fmt: skip
    """The MTF of the edges, which the caption calls `words`, with the diffraction limit and other results."""
    axes, f = plot_axes(), edges[0][1].frequencies
    for number, edge in edges:
        colour = COLOURS[(number - 1) % len(COLOURS)]
        looks: dict[str, Any] = {"colour": colour, "shade": 0.2, "width": 1.2, "label": f"edge {number}"}
        curve(axes, edge.frequencies * axis.factor, edge.mtf, edge.uncertainty, **looks)
    curves = {f"edge {number}": (edge.mtf, edge.uncertainty) for number, edge in edges}
    finish_mtf(axes, curves, f, axis, limit, others)
    end = float(f[-1] * axis.factor)
    caption = f"MTF across {words}; {mtf_caption(axis, limit, others)}"
    return finished(axes, name, caption, xlim=(0, end), xlabel=axis.unit)


MAX_DRAWN = 6
"""Edges of a plane that are drawn; its table has all."""


def edge_page(report: Report) -> str:
    """The page as HTML with embedded figures."""
    photograph: PhotographEdges = report.result
    records = {record.name: (record, f"p{i}") for i, record in enumerate(photograph.records, 1)}
    counts = [f"{record.name}: {record.count}" for record in photograph.records if record.count]
    best = "A plane’s numbers are those of its best edge. " + "; ".join(counts)
    return report_page(
        report,
        summary=[Note(best)],
        plane_blocks=lambda plane: _plane_blocks(report, photograph, *records[plane.name]),
        closing=[Section("Terms and their limits", [Markup(render("edge_words.html"))], anchor="words")],
    )


def _plane_blocks(report: Report, photograph: PhotographEdges, record: EdgeRecord, name: str) -> list[Block]:
    placed = [outcome for outcome in record.outcomes if outcome.roi is not None]
    if not placed:
        return []
    figures = [places_figure(photograph.frame.planes[record.name], placed, f"{name}-places")]
    drawn = [(number, one.value) for number, one in enumerate(placed, 1) if one.value is not None][:MAX_DRAWN]
    if drawn:
        result = record.result
        axis, others = FrequencyAxis(str(result.unit), result.factor), curves_over(report.overlays, result)
        words = f"the first {MAX_DRAWN} edges" if len(placed) > MAX_DRAWN else "the edges"
        figures.append(edges_mtf_figure(drawn, axis, f"{name}-mtf", record.limit, others, words))
        figures.append(spread_figure(drawn, f"{name}-spread"))
    head = ["edge", "measurement", "direction", "x, y, width, height", "numbers", "why"]
    rows = [[str(number), *_cells(record, one)] for number, one in enumerate(placed, 1)]
    return [Figures(figures, summary=True), Table(rows, head, "nwwnrr")]


def _cells(record: EdgeRecord, outcome: EdgeOutcome) -> list[str]:
    """Verdict, direction, region and numbers of an edge in the result's unit."""
    roi, result = outcome.roi, record.result
    numbers = {} if outcome.value is None else convert_numbers(outcome.value.numbers, result.unit, result.factor)
    words = [f"{label(name).replace(' across the edge', '').replace(' of the edge', '')} {quantity(number)}"
             for name, number in numbers.items()]  # fmt: skip
    region = "" if roi is None else f"{roi.x}, {roi.y}, {roi.width}, {roi.height}"
    lines = Markup("<br>").join(words)
    return [tag(outcome.verdict), orientation(outcome.turned), region, lines, reason_words(outcome)]
