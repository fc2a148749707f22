"""Slanted edges of a photograph, and the files of their result."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from procedures.outcome import Verdict
from procedures.raw import RawFrame
from procedures.slanted_edge.estimate import EdgeMtf, estimate_edge, estimate_edges
from procedures.slanted_edge.strip import Roi
from station.edge_pictures import edge_picture
from station.results import ResultFolder, software, write_record

SCHEMA = "station/mtf/1"


@dataclass(frozen=True, eq=False)
class EdgeRecord:
    """What a result says about one plane: its edges, the best first, none where it was refused."""

    name: str
    verdict: Verdict
    reason: str
    remedy: str
    edges: tuple[EdgeMtf, ...]


def measure_edges(frame: RawFrame, roi: Roi | None) -> Iterator[EdgeRecord]:
    """The edge of a region, or all edges that are found, plane by plane.

    Raises
    ------
    BadParameter
        If the region does not lie in a plane.
    """
    for plane in frame.planes.values():
        outcomes = [estimate_edge(plane, roi)] if roi else estimate_edges(plane)
        edges = tuple(outcome.value for outcome in outcomes if outcome.value is not None)
        best = outcomes[0]
        yield EdgeRecord(plane.name, best.verdict, best.reason, best.remedy, edges)


def write_edge_result(
    folder: ResultFolder, frame: RawFrame, records: Sequence[EdgeRecord], parameters: Mapping[str, Any], start: float
) -> str:
    """Write mtf_P.csv and edge_P.png of every plane that has edges, and the record; returns the record's text."""
    for record in records:
        if record.edges:
            folder.write(f"mtf_{record.name}.csv", edge_table(record.edges))
            folder.write(f"edge_{record.name}.png", edge_picture(frame.planes[record.name], record.edges))
    about = {
        "schema": SCHEMA,
        "procedure": "edge",
        "input": [{"path": str(frame.path), "sha256": frame.sha256}],
        "parameters": dict(parameters),
        "planes": {record.name: _plane_entry(record) for record in records},
        "software": software(),
        "duration_s": round(time.perf_counter() - start, 3),
    }
    return write_record(folder, about)


def edge_table(edges: Sequence[EdgeMtf]) -> bytes:
    """The MTFs as CSV: frequency in cycles/pixel, then of each edge its MTF and standard uncertainty."""
    columns = {"frequency": edges[0].frequencies}
    for number, edge in enumerate(edges, 1):
        name = "mtf" if number == 1 else f"mtf_{number}"
        columns[name], columns[f"{name}_uncertainty"] = edge.mtf, edge.uncertainty
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows([f"{value:.9g}" for value in row] for row in zip(*columns.values(), strict=True))
    return text.getvalue().encode()


def _plane_entry(record: EdgeRecord) -> dict[str, Any]:
    """Verdict, the best edge's numbers, and every edge by itself."""
    entry: dict[str, Any] = {"verdict": str(record.verdict), "reason": record.reason, "remedy": record.remedy}
    if record.edges:
        entry |= _numbers(record.edges[0])
        entry["edges"] = [edge_entry(edge) for edge in record.edges]
    return entry


def edge_entry(edge: EdgeMtf) -> dict[str, Any]:
    """One edge: its numbers, where it lies, how it was measured."""
    roi = edge.roi
    return {
        **_numbers(edge),
        "orientation": edge.orientation,
        "normal_deg": edge.normal_deg,
        "roi": [roi.x, roi.y, roi.width, roi.height],
        "order": edge.order,
        "diagnostics": dict(edge.diagnostics),
    }


def _numbers(edge: EdgeMtf) -> dict[str, Any]:
    return {name: asdict(number) for name, number in edge.numbers.items()}
