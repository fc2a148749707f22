"""`station sensor`: what a sensor does with light, from dark pictures and a ladder of even light."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.psf.planes import tell_judged, tell_misses
from station.cli.psf.terms import plane_name
from station.cli.terminal.force import force_option, forced
from station.cli.terminal.progress import progress
from station.common.errors import FAILED_ITEMS, REFUSED
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from procedures.outcome import Miss
    from station.calibration.sensor import SensorPlane


EPILOG = """\
FOLDER holds dark pictures and pictures of even light, two or more of each exposure; three or more of one exposure are
a stack. A manifest in it tells which are which:

\b
sensor.csv    file,kind,exposure_s,photons
              d1.png,dark,0.01,
              a1.png,light,0.01,1500
sensor.toml   [[level]]
              kind = "light"
              exposure_s = 0.01
              photons = 1500
              files = ["a1.png", "a2.png"]

"photons" are photons per pixel, for the quantum efficiency; "light", any number proportional to them, will do where
they are not known; with neither, light is proportional to the exposure time. The descriptor of an EMVA 1288 data set
(lines "b", "d", "i") is read as well. Without a manifest, RAW files in FOLDER/dark and FOLDER/light are sorted by the
exposure time that the camera noted.
"""


@click.command("sensor", epilog=EPILOG)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--plane", callback=plane_name, help="R, G1, G2, B, Y or all.  [default: all]")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--report/--no-report", default=True, show_default=True, help="Write report.html too, for people.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@force_option
@log_json_option
def sensor(folder: Path, plane: str | None, out: Path, *, report: bool, as_json: bool) -> None:
    """Measure gain, noise, linearity, dark current and non-uniformity of a sensor, each with its 95 % interval.

    EMVA 1288 release 4.0, linear and general model, of every plane of a mosaic by itself.
    """
    start = time.perf_counter()
    from station.calibration.sensor import measure_sensor
    from station.calibration.sensor_files import write_sensor_result
    from station.calibration.sensor_folder import find_shots
    from station.results.result_files import ResultFolder

    missed: list[Miss] = []
    shots = find_shots(folder, missed.append)
    count = sum(len(one.paths) for one in shots)
    with ResultFolder(out, force=forced()) as results, progress(count) as told:

        def tell(paths: Iterator[Path]) -> Iterator[Path]:
            for path in paths:
                yield path
                told(f"read {path}")

        found = measure_sensor(shots, plane, tell, missed=missed)
        page = None
        if report:
            from station.reports.sensor_page import sensor_page  # it draws: that import is slow

            page = sensor_page(found)
        text = write_sensor_result(results, found, {"folder": str(folder), "plane": plane or "all"}, start, page)
    tell_misses(found.missed)
    for one in found.planes:
        _tell(one)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if any(one.outcome.verdict == "refused" for one in found.planes):
        raise click.exceptions.Exit(REFUSED)
    if found.missed:
        raise click.exceptions.Exit(FAILED_ITEMS)


def _tell(plane: SensorPlane) -> None:
    """One line on stderr about a plane."""
    from station.common.uncertainty_text import stated

    outcome = plane.outcome
    verdict = str(outcome.verdict)
    parts = [f"{plane.name}: {verdict}"] + ([outcome.reason] if outcome.reason else [])
    from procedures.numbers import Group, in_group

    numbers = outcome.value.numbers if outcome.value is not None else {}
    for name in in_group(Group.LINE, numbers):
        one = numbers[name]
        parts.append(f"{name} {stated(one.value, one.uncertainty)}" + ("" if one.unit == "1" else f" {one.unit}"))
    tell_judged("plane", "; ".join(parts), outcome, plane=plane.name)
