"""`station tilt`: the sensor's plane against the surface of best focus, and the screws that mend it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.planes import chart_options, chart_source, raw_option, tell_judged, tell_misses, told_layout
from station.cli.terminal.force import force_option, forced
from station.cli.terminal.numbers import Number
from station.cli.terminal.progress import progress
from station.common.errors import FAILED_ITEMS, REFUSED
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from procedures.outcome import Outcome
    from procedures.reading.sensor_dump import DumpLayout
    from procedures.tilt.estimate import Tilt, TiltParameters


@click.command("tilt")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--focus", type=click.Path(path_type=Path), required=True, help="A CSV table: photograph's name, position in mm."
)
@click.option(
    "--positions",
    type=click.Choice(["lens", "set", "chart"]),
    default="lens",
    show_default=True,
    help="They tell the lens's distance from the sensor (any zero), the distance it is set to, or the chart's.",
)
@click.option("--position-uncertainty-mm", type=Number(min=0), default=0.0, show_default=True, help="Of each.")
@click.option("--nominal-mm", type=Number(min=-1e5), help="Where the sensor should be in focus: tells the backfocus.")
@click.option("--nominal-uncertainty-mm", type=Number(min=0), default=0.0, show_default=True, help="Of that position.")
@click.option("--focal-length-mm", type=Number(min=0.1), help="[default: as the camera noted it]")
@click.option("--distance-mm", type=Number(min=1), help="Of the chart, where the positions do not tell it.")
@click.option(
    "--chart-tilt-deg",
    type=Number(min=0, max=30),
    default=0.3,
    show_default=True,
    help="Standard uncertainty of the chart's squareness to the lens.",
)
@click.option("--pixel-pitch-um", type=Number(min=0.1), help="Of the sensor.  [default: as the camera noted it]")
@click.option("--screws", type=click.IntRange(3, 12), default=3, show_default=True, help="That hold the sensor.")
@click.option("--screw-radius-mm", type=Number(min=1), required=True, help="Of their circle about the frame's centre.")
@click.option("--screw-pitch-mm", type=Number(min=0.01), required=True, help="What a turn moves the sensor by.")
@click.option(
    "--first-screw-deg",
    type=Number(min=-360, max=360),
    default=0.0,
    show_default=True,
    help="Place of the first, clockwise from the top, seen from behind the camera.",
)
@click.option("--turn-uncertainty", type=Number(min=0), default=0.02, show_default=True, help="Of a turn by hand.")
@click.option("--frequency", type=Number(min=0.01, max=1), default=0.25, show_default=True, help="Cycles per pixel.")
@chart_options
@click.option("--plane", help="R, G1, G2, B or Y.  [default: G1 of RAW files, Y of grey images]")
@raw_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--report/--no-report", default=True, show_default=True, help="Write report.html too, for people.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@force_option
@log_json_option
def tilt(
    folder: Path,
    focus: Path,
    bits: Path | None,
    seed: int | None,
    plane: str | None,
    layout: DumpLayout | None,
    out: Path,
    *,
    report: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Find the sensor's tilt and backfocus from FOLDER, a focus bracket with charts at nine places of the frame.

    Tells how far and which way each screw of the sensor is to be turned, and the probability that this helps. Turn,
    take the bracket again, and run it again.
    """
    start = time.perf_counter()
    source = chart_source(bits, seed)
    from procedures.field.estimate import BRACKET
    from procedures.field.measuring import measure
    from procedures.raw import default_plane
    from station.calibration.field_photographs import focus_positions, photographs
    from station.calibration.tilt import check_known, measure_tilt, write_tilt_result
    from station.reports.tilt_page import tilt_page
    from station.results.result_files import ResultFolder

    paths = photographs(folder)
    positions = focus_positions(focus, paths)
    paths = [path for path in paths if path.name in positions]
    parameters = _parameters(paths[0], options)
    check_known(parameters, positions)  # what is missing is told before the work, not after it
    name = plane or default_plane(paths[0], layout)
    with ResultFolder(out, force=forced()) as results, progress(len(paths)) as told:
        measured = measure(paths, [name], source.chart, BRACKET, told, layout)
        tell_misses(measured.misses)
        found = measure_tilt(measured, name, positions, parameters)
        given = {**options, "chart": source.origin, "pixel_pitch_um": parameters.pixel_pitch_um,
                 "focal_length_mm": parameters.focal_length_mm, **told_layout(layout)}  # fmt: skip
        page = tilt_page(name, len(measured.frames), found) if report else None
        text = write_tilt_result(results, measured, name, found, parameters=given, start=start, page=page)
    _tell(name, found)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if found.value is None:
        raise click.exceptions.Exit(REFUSED)
    if measured.failed:
        raise click.exceptions.Exit(FAILED_ITEMS)


def _parameters(first: Path, options: dict[str, Any]) -> TiltParameters:
    """What was typed, and what the first photograph tells where it was not."""
    from procedures.tilt.estimate import TiltParameters
    from procedures.tilt.positions import Positions
    from procedures.tilt.screws import Screws
    from station.calibration.tilt import noted_optics

    screws = Screws(
        options["screws"], options["screw_radius_mm"], options["screw_pitch_mm"], options["first_screw_deg"],
        options["turn_uncertainty"],
    )  # fmt: skip
    pitch_um, focal_length_mm = noted_optics(first, options["pixel_pitch_um"], options["focal_length_mm"])
    same = ("distance_mm", "position_uncertainty_mm", "chart_tilt_deg", "nominal_mm", "nominal_uncertainty_mm",
            "frequency")  # fmt: skip
    return TiltParameters(
        pitch_um,
        Positions(options["positions"]),
        focal_length_mm,
        screws=screws,
        **{name: options[name] for name in same},
    )


def _tell(plane: str, outcome: Outcome[Tilt]) -> None:
    """Lines on stderr: the numbers, each screw, and whether to turn at all."""
    from procedures.tilt.screws import SURE
    from procedures.tilt.shim import shim_words

    verdict, found = str(outcome.verdict), outcome.value
    parts = [f"{plane}: {verdict}"] + ([outcome.reason] if outcome.reason else [])
    if found is not None:
        parts += [
            f"{name} {one.value:+.1f} ± {one.uncertainty:.1f} {one.unit}" for name, one in found.numbers().items()
        ]
    tell_judged("plane", "; ".join(parts), outcome, plane=plane)
    if found is None:
        return
    screws = zip(found.screws.angles_deg, found.turns.moves, found.turns.turns, strict=True)
    for number, (angle, move, turn) in enumerate(screws, 1):
        way = "away from" if move.value > 0 else "towards"
        log(
            "screw",
            f"screw {number} at {angle:.0f} degrees: {abs(move.value):.1f} ± {move.uncertainty:.1f} um {way} the lens, "
            f"{abs(turn.value):.3f} turn ({abs(turn.value) * 360:.0f} degrees)",
            screw=number, move_um=move.value, turn=turn.value,
        )  # fmt: skip
    if words := shim_words(found):
        log("shim", words, shim_um=found.numbers()["shim"].value)
    helps = found.turns.helps
    advice = "turn, and measure again" if helps >= SURE else "leave it: that is within what was measured and hands do"
    log("advice", f"these turns help with a probability of {helps:.2f}: {advice}", helps=helps)
