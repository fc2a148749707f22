"""`station geometry`: intrinsics, distortion and poses of a camera from photographs of the chart, with covariance."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.planes import chart_options, chart_source, raw_option, tell_judged, told_layout
from station.cli.psf.terms import plane_option
from station.cli.terminal.force import force_option, forced
from station.cli.terminal.numbers import Number
from station.cli.terminal.progress import progress
from station.common.errors import FAILED_ITEMS, REFUSED
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from procedures.geometry.estimate import Geometry
    from procedures.outcome import Outcome
    from procedures.reading.sensor_dump import DumpLayout


@click.command("geometry")
@click.argument("photos", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="PHOTO...")
@chart_options
@click.option(
    "--width-mm",
    type=Number(min=1),
    default=300.0,
    show_default=True,
    help="Width of the printed chart's ten blocks, as measured.",
)
@click.option(
    "--width-uncertainty-mm",
    type=Number(min=0),
    help="Its standard uncertainty; all distances share it.  [default: 0.3 %]",
)
@click.option(
    "--model", help="One of COLMAP's camera models, or OPENCV+SPLINE_12X9.  [default: chosen by views left out]"
)
@click.option(
    "--at-mm", "distances", type=Number(min=1), multiple=True, help="Also tell the uncertainty at a distance."
)
@plane_option
@raw_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--report/--no-report", default=True, show_default=True, help="Write report.html too, for people.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@force_option
@log_json_option
def geometry(
    photos: tuple[Path, ...],
    bits: Path | None,
    seed: int | None,
    width_mm: float,
    width_uncertainty_mm: float | None,
    model: str | None,
    distances: tuple[float, ...],
    plane: str | None,
    layout: DumpLayout | None,
    out: Path,
    report: bool,
    as_json: bool,
) -> None:
    """Calibrate a camera's geometry from PHOTO..., one chart each; a folder or a session stands for its photographs.

    Tilt the chart by 20 to 40 degrees to all sides and show it all over the frame, also in the corners: 12 photographs
    at one focus are a good number.
    """
    start = time.perf_counter()
    source = chart_source(bits, seed)
    from procedures.geometry.cameras import parameter_names
    from procedures.geometry.estimate import GeometryParameters
    from procedures.pattern import BLOCK, BLOCKS
    from station.calibration.geometry import conclude, measure_views
    from station.reports.geometry_files import write_geometry_result
    from station.results.result_files import ResultFolder

    if model is not None:
        parameter_names(model)  # a wrong name is told before the work, not after it
    share = {} if width_uncertainty_mm is None else {"scale_uncertainty": width_uncertainty_mm / width_mm}
    parameters = GeometryParameters(width_mm / (BLOCK * BLOCKS), model=model, distances_mm=distances, **share)
    given = {
        "width_mm": width_mm,
        "scale_uncertainty": parameters.scale_uncertainty,
        "model": model or "auto",
        "chart": source.origin,
        **told_layout(layout),
    }
    paths = _photographs(photos)
    with ResultFolder(out, force=forced()) as folder, progress(len(paths)) as told:
        shoots = measure_views(paths, plane, source.chart, layout, told)
        missed = dict.fromkeys((one.path.name, one.reason, one.remedy) for shoot in shoots for one in shoot.missed)
        for name, reason, remedy in missed:
            log("missed", f"{name}: {reason}", level="warning", remedy=remedy)
        planes = conclude(shoots, parameters)
        text = write_geometry_result(folder, planes, parameters=given, start=start, report=report)
    for one in planes:
        _tell(one.shoot.plane, one.outcome)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if any(one.outcome.value is None for one in planes):
        raise click.exceptions.Exit(REFUSED)
    if missed:
        raise click.exceptions.Exit(FAILED_ITEMS)


def _photographs(given: tuple[Path, ...]) -> list[Path]:
    """The files given, and those of the folders and sessions given."""
    from station.calibration.field_photographs import photographs

    return [path for one in given for path in (photographs(one) if one.is_dir() else [one])]


def _tell(plane: str, outcome: Outcome[Geometry]) -> None:
    verdict, found = str(outcome.verdict), outcome.value
    parts = [f"{plane}: {verdict}"] + ([outcome.reason] if outcome.reason else [])
    if found is not None:
        numbers: dict[str, Any] = found.numbers()
        parts.append(f"{found.camera.model} from {len(found.views)} views")
        for name in ("f", "fx", "fy", "cx", "cy"):
            if name in numbers:
                parts.append(f"{name} {numbers[name].value:.3f} ± {numbers[name].uncertainty:.3f}")
    tell_judged("plane", "; ".join(parts), outcome, plane=plane)
