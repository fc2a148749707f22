"""The MTF of each plane across slanted edges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from procedures.numbers import EDGE_ANGLE, EDGE_MTF50
from procedures.outcome import BadParameter
from station.common.progress import Progress, silent
from station.common.sanitise import stated
from station.procedure.base import Inputs, Procedure, setting
from station.procedure.psf import OpticsReading
from station.results.comparison import measurement_words
from station.results.measurement import Measurement
from station.results.record_head import RecordHead, files_read
from station.results.terms import USUAL, Terms
from station.results.units import convert_quantity

if TYPE_CHECKING:
    from procedures.plan import Advice
    from procedures.raw import RawFrame
    from procedures.slanted_edge.estimate import EdgeOutcome
    from station.calibration.edges import EdgeRecord, PhotographEdges
    from station.reports.report import Report


class EdgeSettings(OpticsReading, frozen=True, kw_only=True):
    """Where the edge is, and the optics."""

    roi: Annotated[
        str | None, setting("Where the edge is, in pixels of the plane.  [default: all edges]", metavar="X,Y,W,H")
    ] = None

    @property
    def region(self) -> tuple[int, int, int, int] | None:
        """First pixel, width and height. Raises BadParameter where the text is not four numbers."""
        if self.roi is None:
            return None
        try:
            x, y, width, height = map(int, self.roi.split(","))
        except ValueError:
            width = height = 0
        if min(width, height) < 1:
            raise BadParameter(
                f"roi must be X,Y,W,H: first pixel, width, height; it is {self.roi!r}", "for example 5,5,50,70"
            )
        return x, y, width, height

    def check(self) -> None:
        """Raise BadParameter if layout or region are invalid."""
        super().check()
        _ = self.region


class SlantedEdge(Procedure[EdgeSettings]):
    """Slanted edges of a photograph."""

    name = "edge"
    title = "MTF across slanted edges"
    help = """Measure the MTF across the slanted edges of IMAGE, each plane by itself and not demosaicked.

    With pitch and aperture known, the light that diffraction throws beyond the edge's plains is known to 5 %; without,
    it is estimated from the plains alone.

    An edge is the straight border of a dark and a bright plain area, some degrees off the axes of the pixels."""
    inputs = Inputs.PHOTOGRAPH
    Settings = EdgeSettings
    schema = "station/mtf/1"
    has_mtf = True
    usual_page = False
    drawn_by = "edges.edge_page:edge_page"
    subject = "edge"

    def check_photograph(self, frame: RawFrame, settings: Mapping[str, Any]) -> Advice:
        """Whether a slanted edge is in the frame; with a region, the procedure gives the verdict."""
        from procedures.slanted_edge.pose import check_edge  # here: mathematics, slow to load

        return super().check_photograph(frame, settings) if settings.get("roi") else check_edge(frame)

    def measure(
        self, paths: Sequence[Path], settings: EdgeSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        """The edge of a region, or all edges that are found."""
        from procedures.slanted_edge.strip import Roi  # here: mathematics, slow to load
        from station.calibration.edges import PhotographEdges, edge_measurement, measure_edges

        region = settings.region
        frame = settings.read(paths[0])
        roi = None if region is None else Roi(*region)
        limit, pixels = settings.limit(frame.exposure), settings.pixels(frame)
        edges = PhotographEdges(frame, tuple(measure_edges(frame, roi, limit, terms, pixels)))
        progress(f"read {paths[0]}")
        given = {"roi": region, **settings.given()}
        return edge_measurement(edges, RecordHead(self.name, files_read([frame]), given), terms)

    def draws(self, measurement: Measurement) -> bool:
        """Always: where an edge was refused is worth seeing."""
        return True

    def report(self, measurement: Measurement) -> Report:
        from station.reports.report import measurement_report  # here: it draws, which is slow to load

        frame = replace(
            measurement.result.frame, path=Path(measurement.head.input[0].path)
        )  # in a session, relative to it
        return measurement_report(measurement, self.name, title=self.title, frames=(frame,))

    def lines(self, measurement: Measurement) -> list[str]:
        """Every edge that has a place, and how many have which verdict."""
        whole: PhotographEdges = measurement.result
        counts = [f"{record.name}: {record.count}" for record in whole.records if record.count]
        return [*(_words(record, edge) for record in whole.records for edge in record.outcomes if edge.roi), *counts]


def _words(record: EdgeRecord, outcome: EdgeOutcome) -> str:
    from procedures.slanted_edge.estimate import orientation

    roi, edge, result = outcome.roi, outcome.value, record.result
    place = "" if roi is None else f" at {roi.x},{roi.y},{roi.width},{roi.height}"
    words = f"{record.name}{place}: {measurement_words(outcome.verdict)}, {orientation(outcome.turned)}"
    if edge is None or EDGE_MTF50 not in edge.numbers:
        return f"{words}; {outcome.reason}"
    mtf50 = convert_quantity(edge.numbers[EDGE_MTF50], result.unit, result.factor)
    angle = edge.numbers[EDGE_ANGLE].value
    return f"{words}, {angle:.2f} degrees; MTF50 {stated(mtf50.value, mtf50.uncertainty)} {mtf50.unit}"
