"""Slanted edges of a photograph, and the files of their result."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from procedures.outcome import Verdict
from procedures.quality import Diffraction
from procedures.raw import Plane, RawFrame
from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome, estimate_edge, estimate_edges, orientation
from procedures.slanted_edge.strip import Roi
from station.drawing.edge_pictures import edge_picture
from station.results.result_files import ResultFolder, software, write_record

SCHEMA = "station/mtf/1"


@dataclass(frozen=True, eq=False)
class EdgeRecord:
    """What a result says about one plane: every edge with its own verdict, the best first.

    The plane's verdict is that of the numbers it reports: of the best edge's.
    """

    name: str
    outcomes: tuple[EdgeOutcome, ...]

    @property
    def best(self) -> EdgeOutcome:
        """The edge whose numbers are the plane's, or the reason why it has none."""
        return self.outcomes[0]

    @property
    def verdict(self) -> Verdict:
        """Of the best edge."""
        return self.best.verdict

    @property
    def edges(self) -> tuple[EdgeMtf, ...]:
        """Those that were measured, the best first."""
        return tuple(one.value for one in self.outcomes if one.value is not None)

    @property
    def count(self) -> str:
        """How many edges have which verdict, in words; "" where there is one or none."""
        verdicts = [one.verdict for one in self.outcomes]
        words = [f"{n} {verdict}" for verdict in Verdict if (n := verdicts.count(verdict))]
        return "" if len(verdicts) < 2 else f"{len(verdicts)} edges: {', '.join(words)}"


def measure_edges(
    frame: RawFrame, roi: Roi | None, limit: Callable[[Plane], Diffraction | None] = lambda _: None
) -> Iterator[EdgeRecord]:
    """The edge of a region, or all edges that are found, plane by plane; `limit` is what is known of diffraction.

    Raises
    ------
    BadParameter
        If the region does not lie in a plane.
    """
    for plane in frame.planes.values():
        known = limit(plane)
        outcomes = [estimate_edge(plane, roi, known)] if roi else estimate_edges(plane, known)
        yield EdgeRecord(plane.name, tuple(outcomes))


def write_edge_result(
    folder: ResultFolder, frame: RawFrame, records: Sequence[EdgeRecord], parameters: Mapping[str, Any], start: float
) -> str:
    """Write mtf_P.csv and edge_P.png of every plane that has edges, and the record; returns the record's text."""
    for record in records:
        if record.edges:
            folder.write(f"mtf_{record.name}.csv", edge_table(record.edges))
            measured = [one for one in record.outcomes if one.value is not None]
            folder.write(f"edge_{record.name}.png", edge_picture(frame.planes[record.name], measured))
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
    """Verdict, the best edge's numbers, and every edge by itself with its own verdict."""
    best = record.best
    entry: dict[str, Any] = {"verdict": str(best.verdict), "reason": best.reason, "remedy": best.remedy}
    if best.value is not None:
        entry |= _numbers(best.value)
    placed = [edge_entry(one) for one in record.outcomes if one.roi is not None]
    return entry | {"edges": placed} if placed else entry


def edge_entry(outcome: EdgeOutcome) -> dict[str, Any]:
    """One edge: its verdict and where it lies; where it is not refused its numbers, and how it was measured."""
    roi, edge = outcome.roi, outcome.value
    entry: dict[str, Any] = {
        "verdict": str(outcome.verdict),
        "reason": outcome.reason,
        "remedy": outcome.remedy,
        "roi": None if roi is None else [roi.x, roi.y, roi.width, roi.height],
        "orientation": orientation(outcome.turned),
    }
    if edge is None:
        return entry
    return entry | {
        **_numbers(edge),
        "normal_deg": edge.normal_deg,
        "order": edge.order,
        "diagnostics": dict(edge.diagnostics),
    }


def _numbers(edge: EdgeMtf) -> dict[str, Any]:
    return {name: asdict(number) for name, number in edge.numbers.items()}
