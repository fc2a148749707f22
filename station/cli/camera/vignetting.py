"""`station vignetting`: light that is lost towards the corners, by plane, from photographs of even light."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.psf.planes import tell_judged, tell_misses
from station.cli.terminal.progress import progress
from station.common.errors import FAILED_ITEMS, REFUSED
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from procedures.outcome import Outcome
    from procedures.vignetting.estimate import PlaneVignetting

TOLD = ("corner_light", "darkest_corner", "vignetting_centre_x", "vignetting_centre_y", "colour_shading")
"""Numbers of the line on stderr."""


@click.command("vignetting")
@click.argument("flats", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="FLAT...")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@log_json_option
def vignetting(flats: tuple[Path, ...], out: Path, as_json: bool) -> None:
    """Measure vignetting and colour shading from FLAT..., photographs of even light; a folder stands for its own.

    Turn the camera, or the light, by 180 or 90 degrees about the axis between the flats: a slope of the light is then
    told from the lens. Expose to half of the scale.
    """
    start = time.perf_counter()
    from station.calibration.field_photographs import photographs
    from station.calibration.vignetting import measure_flats, write_vignetting_result
    from station.results.result_files import ResultFolder

    paths = [path for one in flats for path in (photographs(one) if one.is_dir() else [one])]
    with ResultFolder(out) as folder, progress(len(paths)) as told:
        found = measure_flats(paths, told)
        text = write_vignetting_result(folder, found, start)
    tell_misses(found.missed)
    for name, outcome in found.planes.items():
        _tell(name, outcome)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if all(outcome.value is None for outcome in found.planes.values()):
        raise click.exceptions.Exit(REFUSED)
    if found.missed:
        raise click.exceptions.Exit(FAILED_ITEMS)


def _tell(plane: str, outcome: Outcome[PlaneVignetting]) -> None:
    verdict = str(outcome.verdict)
    parts = [f"{plane}: {verdict}"] + ([outcome.reason] if outcome.reason else [])
    if outcome.value is not None:
        numbers = outcome.value.numbers
        parts += [
            f"{name} {numbers[name].value:.4g} ± {numbers[name].uncertainty:.2g}" for name in TOLD if name in numbers
        ]
    tell_judged("plane", "; ".join(parts), outcome, plane=plane)
