"""`station export`: a result as a file of another program."""

from __future__ import annotations

from pathlib import Path

import click

from station.common.log import log, log_json_option

CAMERAS = ("opencv", "ros", "kalibr", "colmap", "mrcal")
"""Formats that hold a camera's geometry."""


@click.command("export")
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--to", "form", type=click.Choice(CAMERAS), required=True, help="Of which program.")
@click.argument("out", type=click.Path(path_type=Path))
@log_json_option
def export(result: Path, form: str, out: Path) -> None:
    """Write RESULT, a folder or its result.json, as the file OUT of another program.

    What the format cannot hold is told in pixels, over the part of the frame that was measured.
    """
    from station.calibration.geometry_exports import export_camera, read_camera
    from station.common.atomic_files import write_whole

    made = export_camera(read_camera(result), form)
    write_whole(out, made.text.encode())
    lost = made.difference
    if lost is not None:
        words = (
            f"{form} cannot hold all of this camera: {lost.rms_px:.4f} pixel rms, {lost.max_px:.4f} at most, are lost"
        )
        log("lost", words, level="warning", rms_px=lost.rms_px, max_px=lost.max_px)
    log("written", f"wrote {out}", path=str(out))
