"""`station export`: a result as a file for another program."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.psf.terms import plane_name
from station.cli.terminal.command import PATH, FiniteNumber, command
from station.common.errors import log

if TYPE_CHECKING:
    from station.calibration.exports import Export
    from station.calibration.exports.lensfun import GivenNames

CAMERAS = ("opencv", "ros", "kalibr", "colmap", "mrcal")
PSFS = ("stdpsf", "psfex", "deepinv")
LENSES = ("lensfun", "dng")


@command("export")
@click.argument("result", type=PATH)
@click.option("--to", "form", type=click.Choice((*CAMERAS, *PSFS, *LENSES)), required=True, help="The format.")
@click.option("--plane", callback=plane_name, help="Of the result.  [default: G1, or the first plane]")
@click.option("--field", type=PATH, help="lensfun: a result of station psf field, for lateral colour.")
@click.option("--vignetting", type=PATH, help="lensfun, dng: a result of station vignetting.")
@click.option("--gain-map", is_flag=True, help="dng: vignetting as a gain map for each plane, with colour shading.")
@click.option("--photo", type=PATH, help="dng: the photograph to copy.")
@click.option("--maker", default="unknown", show_default=True, help="lensfun: of camera and lens.")
@click.option("--camera", help="lensfun: its model.  [default: from the field]")
@click.option("--lens", help="lensfun: its name.  [default: from the field]")
@click.option("--focal-length-mm", type=FiniteNumber(min=0.1), help="lensfun.  [default: from the field]")
@click.option("--f-number", type=FiniteNumber(min=0.1), help="lensfun: of the vignetting.  [default: from the field]")
@click.option("--pixel-pitch-um", type=FiniteNumber(min=0.1), help="lensfun.  [default: by the focal length]")
@click.argument("out", type=PATH)
def export(
    result: Path, form: str, plane: str | None, field: Path | None, vignetting: Path | None, gain_map: bool,
    photo: Path | None, maker: str, camera: str | None, lens: str | None, focal_length_mm: float | None,
    f_number: float | None, pixel_pitch_um: float | None, out: Path,
) -> None:  # fmt: skip
    """Write RESULT, a folder or the file in it, as the file OUT for another program.

    Cameras of `station geometry` (result.json) go to opencv, ros, kalibr, colmap and mrcal, with --field and
    --vignetting to lensfun, with --photo into the copy of a DNG; fields of `station psf field` (field.h5) to stdpsf
    (photutils), psfex and deepinv. The error of the conversion is reported: for a camera in pixels over the measured
    part of the frame, for light and PSF as a fraction.
    """
    from station.calibration.exports.geometry import export_camera
    from station.calibration.exports.lensfun import GivenNames
    from station.calibration.exports.psf import PSF_FORMATS, read_plane
    from station.calibration.stored_cameras import read_camera

    if form in PSFS:
        made = PSF_FORMATS[form](read_plane(result, plane))
    elif form == "lensfun":
        given = GivenNames(maker, camera, lens, focal_length_mm, f_number, pixel_pitch_um)
        made = _lensfun(result, plane, field, vignetting, given)
    elif form == "dng":
        made = _dng(result, plane, vignetting, photo, out, gain_map=gain_map)
    else:
        made = export_camera(read_camera(result, plane), form)
    write_export(made, result, out)


def write_export(made: Export, result: Path, out: Path) -> None:
    """Write the file, and report what it does not represent. Raises BadParameter if it would replace the result."""
    from procedures.outcome import BadParameter
    from station.common.durable_files import write_whole

    if out.exists() and out.samefile(result):
        raise BadParameter(f"the export must be another file than the result; got {out}", "name another file")
    write_whole(out, made.data)
    for one in made.lost:
        log("lost", one)
    log("written", f"wrote {out}", path=str(out))


def _lensfun(result: Path, plane: str | None, field: Path | None, vignetting: Path | None, given: GivenNames) -> Export:
    from procedures.field.field_file import read_camera as read_exposure
    from procedures.field.field_file import read_colours
    from station.calibration.exports.lensfun import export_lensfun
    from station.calibration.exports.psf import field_path
    from station.calibration.stored_cameras import read_camera
    from station.calibration.vignetting import green_of, read_vignetting

    stored = read_camera(result, plane)
    path = field_path(field) if field is not None else None
    exposure = read_exposure(path) if path is not None else None
    names = given.completed(exposure, stored.camera.focal_px[0], with_light=vignetting is not None)
    colours = read_colours(path) if path is not None else None
    light = green_of(read_vignetting(vignetting)).light if vignetting is not None else None
    return export_lensfun(stored, names, colours, light)


def _dng(
    result: Path, plane: str | None, vignetting: Path | None, photo: Path | None, out: Path, *, gain_map: bool
) -> Export:
    from procedures.outcome import BadParameter
    from procedures.raw import default_plane, read_frame
    from procedures.reading.guard import read_file
    from station.calibration.exports.dng import export_dng
    from station.calibration.stored_cameras import read_camera
    from station.calibration.stored_results import procedure_of
    from station.calibration.vignetting import green_of, read_vignetting

    if photo is None:
        raise BadParameter(
            "a DNG's opcodes are written into a copy of a photograph, which was not given", "give --photo"
        )
    if out.exists() and out.samefile(photo):
        raise BadParameter(f"the copy must be another file than the photograph; got {out}", "name another file")
    of_light = procedure_of(result, "name a result of station geometry or station vignetting") == "vignetting"
    stored = None if of_light else read_camera(result, plane)
    light = result if of_light else vignetting
    data = read_file(photo)
    frame = read_frame(photo, None if gain_map else [default_plane(photo)], data=data)
    first = next(iter(frame.planes.values()))
    rows, columns = (n * first.pitch for n in first.samples.shape)
    lights = read_vignetting(light) if light else {}
    green = green_of(lights) if light and not gain_map else None
    shading = None
    if gain_map:
        missing = [name for name in frame.planes if name not in lights]
        if missing:
            raise BadParameter(
                f"a gain map is required for every plane; the flats have none of {', '.join(missing)}",
                "give the result of station vignetting, of RAW files of this camera",
            )
        shading = {name: (lights[name], one.origin) for name, one in frame.planes.items()}
    return export_dng(data, photo.name, stored, green, (columns, rows), shading)
