"""`station export`: a result as a file of another program."""

from __future__ import annotations

from pathlib import Path

import click

from station.common.log import log, log_json_option

CAMERAS = ("opencv", "ros", "kalibr", "colmap", "mrcal")
"""Formats that hold a camera's geometry."""
PSFS = ("stdpsf", "psfex", "deepinv")
"""Formats that hold the PSF over the frame."""


@click.command("export")
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--to", "form", type=click.Choice((*CAMERAS, *PSFS)), required=True, help="Of which program.")
@click.option("--plane", help="Of a PSF field.  [default: G1, or the first there is]")
@click.argument("out", type=click.Path(path_type=Path))
@log_json_option
def export(result: Path, form: str, plane: str | None, out: Path) -> None:
    """Write RESULT, a folder or the file in it, as the file OUT of another program.

    Cameras of `station geometry` (result.json) go to opencv, ros, kalibr, colmap and mrcal; fields of `station psf
    field` (field.h5) to stdpsf (photutils), psfex and deepinv. What the format cannot hold is told: of a camera in
    pixels over the part of the frame that was measured, of a field as a share of the PSF's norm.
    """
    if form in PSFS:
        _export_field(result, form, plane, out)
    else:
        _export_camera(result, form, out)
    log("written", f"wrote {out}", path=str(out))


def _export_camera(result: Path, form: str, out: Path) -> None:
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


def _export_field(result: Path, form: str, plane: str | None, out: Path) -> None:
    from station.calibration.psf_exports import export_field, read_plane
    from station.common.atomic_files import write_whole

    field = read_plane(result, plane)
    made = export_field(field, form)
    write_whole(out, made.data)
    if made.lost:
        log("lost", f"{form}, plane {field.plane}: {made.lost}", plane=field.plane)
