"""`station rig`: how two cameras on one rig stand to each other, from their geometries."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.psf.planes import tell_judged
from station.cli.psf.terms import plane_name
from station.cli.terminal.force import force_option, forced
from station.common.errors import REFUSED
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from procedures.geometry.rig import RigPose
    from procedures.outcome import Outcome


@click.command("rig")
@click.argument("first", type=click.Path(path_type=Path))
@click.argument("second", type=click.Path(path_type=Path))
@click.option("--plane", callback=plane_name, help="Of both.  [default: G1, or the first there is]")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@force_option
@log_json_option
def rig(first: Path, second: Path, plane: str | None, out: Path, *, as_json: bool) -> None:
    """Tell the pose of a rig's SECOND camera by its FIRST: results of station geometry, of one chart seen by both.

    Photographs that were taken at one time have one name in both; where none has, they belong together in their order.
    """
    start = time.perf_counter()
    from procedures.geometry.rig import estimate_rig
    from procedures.outcome import BadInput
    from station.calibration.rig import read_rig_camera, write_rig_result
    from station.results.result_files import ResultFolder

    cameras = read_rig_camera(first, plane), read_rig_camera(second, plane)
    if cameras[0].file.sha256 == cameras[1].file.sha256:
        raise BadInput(f"{first} and {second} are one geometry", "name the results of the rig's two cameras")
    found = estimate_rig(cameras[0].charts, cameras[1].charts)
    with ResultFolder(out, force=forced()) as folder:
        text = write_rig_result(folder, cameras, found, start)
    _tell(found)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if found.value is None:
        raise click.exceptions.Exit(REFUSED)


def _tell(outcome: Outcome[RigPose]) -> None:
    verdict, found = str(outcome.verdict), outcome.value
    parts = [f"rig: {verdict}"] + ([outcome.reason] if outcome.reason else [])
    if found is not None:
        parts += [f"{name} {one.value:.4f} ± {one.uncertainty:.2g} {one.unit}" for name, one in found.numbers().items()]
        parts.append(f"from {len(found.charts)} charts")
    tell_judged("rig", "; ".join(parts), outcome)
