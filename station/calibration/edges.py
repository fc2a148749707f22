"""Slanted edges of a photograph, and their measurement."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from procedures.numbers import CYCLES, PROBABILITY, name_at
from procedures.outcome import Quantity, Verdict
from procedures.quality import Diffraction
from procedures.raw import Plane, RawFrame
from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome, estimate_edge, estimate_edges, orientation
from procedures.slanted_edge.strip import Roi
from station.drawing.plots import edge_picture
from station.results.exports import csv_columns
from station.results.limits import place_of
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, verdict_entry
from station.results.terms import USUAL, Terms
from station.results.units import Pixels, convert_numbers, pixels_of

SCHEMA = "station/mtf/1"


@dataclass(frozen=True, eq=False)
class EdgeRecord:
    """The edges of one plane, each with its verdict, the best first.

    The plane reports numbers and verdict of the best edge.

    result : the best edge's numbers in the requested unit, compared with the specification
    at : frequencies at which the MTF is reported, in cycles per pixel of the plane
    limit : the diffraction limit, where it is known
    """

    name: str
    outcomes: tuple[EdgeOutcome, ...]
    result: PlaneResult
    at: tuple[float, ...] = ()
    limit: Diffraction | None = None

    @property
    def best(self) -> EdgeOutcome:
        """The edge reported for the plane, or the reason why there is none."""
        return self.outcomes[0]

    @property
    def edges(self) -> tuple[EdgeMtf, ...]:
        """The measured edges, the best first."""
        return tuple(outcome.value for outcome in self.outcomes if outcome.value is not None)

    @property
    def count(self) -> str:
        """Number of edges by verdict, as text; "" for fewer than two."""
        verdicts = [outcome.verdict for outcome in self.outcomes]
        words = [f"{n} {verdict}" for verdict in Verdict if (n := verdicts.count(verdict))]
        return "" if len(verdicts) < 2 else f"{len(verdicts)} edges: {', '.join(words)}"


@dataclass(frozen=True, eq=False)
class PhotographEdges:
    """A photograph and the edges of each of its planes."""

    frame: RawFrame
    records: tuple[EdgeRecord, ...]


def measure_edges(
    frame: RawFrame,
    roi: Roi | None,
    limit: Callable[[Plane], Diffraction | None] = lambda _: None,
    terms: Terms = USUAL,
    pixels: Mapping[str, Pixels] | None = None,
) -> Iterator[EdgeRecord]:
    """The edge of a region, or all, plane by plane. Raises BadParameter for a region outside a plane, or an unknown of
    the unit."""
    pixels = pixels or pixels_of(frame)
    for plane in frame.planes.values():
        known, at = limit(plane), terms.frequencies(pixels[plane.name])
        outcomes = [estimate_edge(plane, roi, known)] if roi else estimate_edges(plane, known)
        result = terms.apply(_result(plane, outcomes[0], at), pixels[plane.name])
        yield EdgeRecord(plane.name, tuple(outcomes), result, at, known)


def _result(plane: Plane, best: EdgeOutcome, at: Sequence[float]) -> PlaneResult:
    edge = best.value
    rows, columns = plane.samples.shape
    roi = best.roi
    place = "" if roi is None else place_of(roi.x + roi.width / 2, roi.y + roi.height / 2, (rows, columns))
    curves = edge and {"frequency": edge.frequencies, "mtf": edge.mtf, "mtf_uncertainty": edge.uncertainty}
    return PlaneResult.of_outcome(
        plane.name, best, numbers=_numbers(edge, at) if edge else {}, curves=curves or {},
        values=_probable(edge) if edge else {}, pitch=plane.pitch, place=str(place),
    )  # fmt: skip


def _probable(edge: EdgeMtf) -> dict[str, float]:
    return {PROBABILITY: edge.probability} if math.isfinite(edge.probability) else {}


def _numbers(edge: EdgeMtf, at: Sequence[float]) -> dict[str, Quantity]:
    """An edge's numbers, and its MTF at frequencies in cycles per pixel of the plane."""
    return {**edge.numbers, **{name_at(f): number for f in at if (number := edge.at(f)) is not None}}


def edge_measurement(photograph: PhotographEdges, head: RecordHead, terms: Terms) -> Measurement:
    """Every plane with its edges, their MTFs as tables, and a picture of their positions."""
    files: dict[str, Any] = {}
    for record in photograph.records:
        if record.edges:
            columns = {f"frequency [{record.result.unit}]": record.edges[0].frequencies * record.result.factor}
            for number, edge in enumerate(record.edges, 1):
                name = "mtf" if number == 1 else f"mtf_{number}"
                columns[name], columns[f"{name}_uncertainty"] = edge.mtf, edge.uncertainty
            files[f"mtf_{record.name}.csv"] = csv_columns(columns, 9)
            measured = [outcome for outcome in record.outcomes if outcome.value is not None]
            plane, unit = photograph.frame.planes[record.name], str(record.result.unit)
            files[f"edge_{record.name}.png"] = edge_picture(plane, measured, unit, record.result.factor)
    planes = tuple(replace(one.result, details=_entries(one)) for one in photograph.records)
    frequencies = photograph.records[0].at if photograph.records else ()
    at = {"at": list(frequencies)} if frequencies else {}
    whole = replace(
        head, parameters={**head.parameters, **terms.parameters(), **at}, specification=terms.specified(planes)
    )
    return Measurement(
        SCHEMA, whole, planes, files=files, exposure=photograph.frame.exposure, terms=terms, result=photograph
    )  # fmt: skip


def _entries(record: EdgeRecord) -> dict[str, Any]:
    edges = [_edge_entry(outcome, record) for outcome in record.outcomes if outcome.roi is not None]
    return {"edges": edges} if edges else {}


def _edge_entry(outcome: EdgeOutcome, record: EdgeRecord) -> dict[str, Any]:
    """One edge: verdict and position; unless it is refused, its numbers and the details of the measurement."""
    roi, edge, result = outcome.roi, outcome.value, record.result
    entry: dict[str, Any] = {
        **verdict_entry(outcome),
        "roi": None if roi is None else [roi.x, roi.y, roi.width, roi.height],
        "orientation": orientation(outcome.turned),
    }
    if edge is None:
        return entry
    numbers = convert_numbers(_numbers(edge, record.at), result.unit, result.factor)
    return entry | {
        **{name: asdict(number) | _budget(edge, name, result.factor) for name, number in numbers.items()},
        **_probable(edge),
        "normal_deg": edge.normal_deg,
        "order": edge.order,
        "diagnostics": dict(edge.diagnostics),
    }


def _budget(edge: EdgeMtf, name: str, factor: float) -> dict[str, Any]:
    """The terms of a number's uncertainty in the number's unit; empty where it has no budget."""
    if name not in edge.budgets:
        return {}
    scale = factor if edge.numbers[name].unit == CYCLES else 1.0
    return {"budget": {term: scale * uncertainty for term, uncertainty in edge.budgets[name].items()}}
