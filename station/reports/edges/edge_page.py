"""The page of a photograph's slanted edges: verdict first, every edge with its own, its place, spread and MTF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from procedures.numbers import label
from procedures.outcome import Quantity
from procedures.raw import Plane, RawFrame
from procedures.slanted_edge.estimate import orientation
from station.calibration.edges import EdgeRecord
from station.reports.edges.edge_figures import edges_mtf_figure, places_figure, spread_figure
from station.reports.otf_figures import FrequencyAxis
from station.reports.page import render
from station.reports.pattern_report import Report, curves_over, report_of_files
from station.results.overlay import Overlay
from station.results.terms import Terms
from station.results.units import told_numbers

SHOWN = 6
"""Edges of a plane that are drawn; its table tells all."""


def edge_report(
    frame: RawFrame, records: Sequence[EdgeRecord], parameters: Mapping[str, object], terms: Terms,
    overlays: Sequence[Overlay] = (),
) -> Report:  # fmt: skip
    """What page and certificate tell of a photograph's edges."""
    results = [one.result for one in records]
    return report_of_files("edge", [frame], results, parameters, terms.specification, overlays)


def edge_page(report: Report, frame: RawFrame, records: Sequence[EdgeRecord]) -> str:
    """The page as HTML, its pictures inside; everything in it that came from outside is escaped."""
    sheets = [
        (sheet, record, _edges(record), _pictures(record, frame.planes[record.name], report, f"p{i}"))
        for i, (sheet, record) in enumerate(zip(report.planes, records, strict=True), 1)
    ]
    files = ["result.json"]
    for one in records:
        files += [f"mtf_{one.name}.csv", f"edge_{one.name}.png"] if one.edges else []
    return render("edge.html", report=report, sheets=sheets, shown=SHOWN, files=files)


def _edges(record: EdgeRecord) -> list[dict[str, Any]]:
    """Every edge that has a place: its number, verdict, where it lies, and its numbers in the result's unit."""
    found = []
    for number, one in enumerate((one for one in record.outcomes if one.roi is not None), 1):
        told = {} if one.value is None else told_numbers(one.value.numbers, record.result.unit, record.result.factor)
        found.append({"number": number, "outcome": one, "way": orientation(one.turned), "numbers": _worded(told)})
    return found


def _worded(numbers: Mapping[str, Quantity]) -> list[tuple[str, Quantity]]:
    return [(label(name), one) for name, one in numbers.items()]


def _pictures(record: EdgeRecord, plane: Plane, report: Report, name: str) -> dict[str, Any]:
    """The figures of a plane: where its edges lie, and of those that were measured spread and MTF."""
    placed = [one for one in record.outcomes if one.roi is not None]
    pictures: dict[str, Any] = {"places": places_figure(plane, placed, f"{name}-places")} if placed else {}
    shown = [(number, one.value) for number, one in enumerate(placed, 1) if one.value is not None][:SHOWN]
    if shown:
        others = curves_over(report.overlays, record.result)
        axis = FrequencyAxis(str(record.result.unit), record.result.factor)
        pictures["spread"] = spread_figure(shown, f"{name}-spread")
        pictures["mtf"] = edges_mtf_figure(shown, axis, f"{name}-mtf", record.limit, others)
        pictures["others"] = list(others)
    return pictures
