"""`station mtf edge`: the MTF of each plane across slanted edges."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from procedures.numbers import EDGE_MTF50
from station.cli.psf.planes import (
    certificate_option,
    finish,
    overlay_option,
    raw_option,
    read_overlays,
    read_planes,
    tell_judged,
    tell_untold,
    told_layout,
)
from station.cli.psf.terms import plane_option, terms_of, terms_options
from station.cli.terminal.force import forced
from station.cli.terminal.numbers import Number
from station.common.log import log, log_json_option
from station.results.record_head import RecordHead, files_read

if TYPE_CHECKING:
    from procedures.raw import RawFrame
    from procedures.reading.sensor_dump import DumpLayout
    from procedures.slanted_edge.estimate import EdgeOutcome
    from station.calibration.edges import EdgeRecord
    from station.results.overlay import Overlay
    from station.results.plane_result import PlaneResult
    from station.results.result_files import ResultFolder
    from station.results.terms import Terms


def _roi(context: click.Context, option: click.Parameter, words: str | None) -> tuple[int, ...] | None:
    """The four whole numbers of X,Y,W,H."""
    if words is None:
        return None
    try:
        numbers = tuple(int(word) for word in words.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 4 or min(numbers[2:]) < 1:
        raise click.BadParameter(f"{words!r} is no X,Y,W,H: first pixel, width, height", context, option)
    return numbers


@click.command("edge")
@click.argument("image", type=click.Path(path_type=Path))
@click.option(
    "--roi", callback=_roi, metavar="X,Y,W,H", help="Where the edge is, in pixels of the plane.  [default: all edges]"
)
@plane_option
@click.option("--pixel-pitch-um", type=Number(min=0.1), help="The sensor's pitch: what diffraction throws far.")
@click.option("--f-number", type=Number(min=0.1), help="The aperture.  [default: as the camera noted it]")
@click.option("--wavelength-nm", type=Number(min=100), help="[default: R 600, G 530, B 460, Y 550]")
@raw_option
@terms_options
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--report", is_flag=True, help="Write report.html too, for people.")
@certificate_option
@overlay_option
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@log_json_option
def mtf_edge(
    image: Path,
    roi: tuple[int, ...] | None,
    plane: str | None,
    layout: DumpLayout | None,
    out: Path,
    *,
    report: bool,
    certificate: bool,
    overlays: tuple[Path, ...],
    as_json: bool,
    **options: Any,
) -> None:
    """Measure the MTF across the slanted edges of IMAGE, each plane by itself and not demosaicked.

    With pitch and aperture known, so is the light that diffraction throws beyond the edge's plains, to 5 %; without, it
    is drawn from the plains alone.

    An edge is the straight border of a dark and a bright plain area, some degrees off the axes of the pixels.
    """
    start = time.perf_counter()
    from procedures.slanted_edge.strip import Roi
    from station.calibration.edges import measure_edges, write_edge_result
    from station.calibration.planes import diffraction_limit
    from station.results.result_files import ResultFolder

    terms, others = terms_of(options), read_overlays(overlays)
    optics = options
    with ResultFolder(out, force=forced()) as folder:
        frame = read_planes(image, plane, layout)
        limit = partial(diffraction_limit, frame.exposure, **optics)
        records = []
        for record in measure_edges(frame, Roi(*roi) if roi else None, limit, terms, optics["pixel_pitch_um"]):
            _tell(record)
            records.append(record)
        known = {name: value for name, value in optics.items() if value is not None}
        given = {"roi": roi, **known, **told_layout(layout)}
        parameters = {**given, **terms.parameters()}
        head = RecordHead(
            "edge",
            files_read([frame]),
            parameters,
            terms.specified([record.result for record in records]),
            duration_s=round(time.perf_counter() - start, 3),
        )
        if report or certificate or others:
            _write_pages(folder, frame, records, parameters, terms, others, certificate=certificate)
        text = write_edge_result(folder, frame, records, head)
        log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    finish([record.result for record in records], text, as_json=as_json)


def _write_pages(
    folder: ResultFolder,
    frame: RawFrame,
    records: Sequence[EdgeRecord],
    given: Mapping[str, object],
    terms: Terms,
    overlays: Sequence[Overlay],
    *,
    certificate: bool,
) -> None:
    """The page, and the certificate where it is wanted."""
    from station.reports.edges.edge_page import edge_page, edge_report  # here: it draws, which is slow to load
    from station.reports.pattern_report import PAGE

    told = edge_report(frame, records, given, terms, overlays)
    folder.write(PAGE, edge_page(told, frame, records).encode())
    if certificate:
        from station.reports.certificate_print import write_certificate

        write_certificate(folder, told)


def _tell(record: EdgeRecord) -> None:
    """The plane's line, then one for every other edge that has a place."""
    _tell_edge(record.result, record.best, record.count)
    for outcome in record.outcomes[1:]:
        _tell_edge(record.result, outcome)
    tell_untold(record.result)


def _tell_edge(told: PlaneResult, outcome: EdgeOutcome, also: str = "") -> None:
    from station.common.uncertainty_text import stated
    from station.results.units import told_quantity
    from station.results.verdict_words import measurement_words

    plane = told.name
    verdict, roi, edge = str(outcome.verdict), outcome.roi, outcome.value
    at = f"{plane} at {roi.x},{roi.y},{roi.width},{roi.height}" if roi else plane
    parts = [f"{at}: {measurement_words(verdict)}"] + [words for words in (outcome.reason,) if words]
    if edge is not None and EDGE_MTF50 in edge.numbers:
        mtf50 = told_quantity(edge.numbers[EDGE_MTF50], told.unit, told.factor)
        parts.append(
            f"MTF50 {stated(mtf50.value, mtf50.uncertainty)} {mtf50.unit} across the {edge.orientation} edge at "
            f"{edge.numbers['angle'].value:.2f} degrees"
        )
    parts += [also] if also else []
    tell_judged("plane", "; ".join(parts), outcome, plane=plane)
