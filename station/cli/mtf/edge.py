"""`station mtf edge`: the MTF of each plane across slanted edges."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.planes import LEVELS, raw_option, read_planes, told_layout
from station.cli.terminal.numbers import Number
from station.common.errors import REFUSED
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from procedures.reading.sensor_dump import DumpLayout
    from procedures.slanted_edge.estimate import EdgeOutcome
    from station.calibration.edges import EdgeRecord


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
@click.option("--plane", help="R, G1, G2, B, Y or all.  [default: G1 of a RAW file, Y of a grey image]")
@click.option("--pixel-pitch-um", type=Number(min=0.1), help="The sensor's pitch: what diffraction throws far.")
@click.option("--f-number", type=Number(min=0.1), help="The aperture.  [default: as the camera noted it]")
@click.option("--wavelength-nm", type=Number(min=100), help="[default: R 600, G 530, B 460, Y 550]")
@raw_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@log_json_option
def mtf_edge(
    image: Path,
    roi: tuple[int, ...] | None,
    plane: str | None,
    layout: DumpLayout | None,
    out: Path,
    *,
    as_json: bool,
    **optics: Any,
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

    with ResultFolder(out) as folder:
        frame = read_planes(image, plane, layout)
        limit = partial(diffraction_limit, frame.exposure, **optics)
        records = []
        for record in measure_edges(frame, Roi(*roi) if roi else None, limit):
            _tell(record)
            records.append(record)
        known = {name: value for name, value in optics.items() if value is not None}
        text = write_edge_result(folder, frame, records, {"roi": roi, **known, **told_layout(layout)}, start)
        log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if any(record.verdict == "refused" for record in records):
        raise click.exceptions.Exit(REFUSED)


def _tell(record: EdgeRecord) -> None:
    """The plane's line, then one for every other edge that has a place."""
    _tell_edge(record.name, record.best, record.count)
    for outcome in record.outcomes[1:]:
        _tell_edge(record.name, outcome)


def _tell_edge(plane: str, outcome: EdgeOutcome, also: str = "") -> None:
    verdict, roi, edge = str(outcome.verdict), outcome.roi, outcome.value
    at = f"{plane} at {roi.x},{roi.y},{roi.width},{roi.height}" if roi else plane
    parts = [f"{at}: {verdict}"] + [words for words in (outcome.reason,) if words]
    if edge is not None and "mtf50" in edge.numbers:
        numbers = edge.numbers
        parts.append(
            f"MTF50 {numbers['mtf50'].value:.4f} ± {numbers['mtf50'].uncertainty:.4f} cycles/pixel across the "
            f"{edge.orientation} edge at {numbers['angle'].value:.2f} degrees"
        )
    parts += [also] if also else []
    log("plane", "; ".join(parts), level=LEVELS[verdict], remedy=outcome.remedy, plane=plane, verdict=verdict)
