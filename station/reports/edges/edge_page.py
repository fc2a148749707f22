"""The page of a photograph's slanted edges: places, spread functions and MTF of every plane, every edge's numbers."""

from markupsafe import Markup

from procedures.numbers import label
from procedures.slanted_edge.estimate import EdgeOutcome, orientation
from station.calibration.edges import EdgeRecord, PhotographEdges
from station.reports.edges.edge_figures import edges_mtf_figure, places_figure, spread_figure
from station.reports.otf_figures import FrequencyAxis
from station.reports.page import Block, Figures, Note, Section, Table, quantity, reason_words, render, tag
from station.reports.report import Report
from station.reports.report_page import curves_over, report_page
from station.results.units import convert_numbers

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
    roi, result = outcome.roi, record.result
    numbers = {} if outcome.value is None else convert_numbers(outcome.value.numbers, result.unit, result.factor)
    words = [f"{label(name).replace(' across the edge', '').replace(' of the edge', '')} {quantity(number)}"
             for name, number in numbers.items()]  # fmt: skip
    region = "" if roi is None else f"{roi.x}, {roi.y}, {roi.width}, {roi.height}"
    lines = Markup("<br>").join(words)
    return [tag(outcome.verdict), orientation(outcome.turned), region, lines, reason_words(outcome)]
