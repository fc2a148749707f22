"""`station profile ...`: the library of measured fields, and filters for other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.export import write_export
from station.cli.terminal.command import PATH, FiniteNumber, columns, command, options
from station.cli.terminal.lazy import LazyGroup
from station.common.errors import log

if TYPE_CHECKING:
    from procedures.raw import Exposure

PROFILE_COMMANDS = {
    "add": ("profile", "profile_add", "Add the field of a result to the library."),
    "find": ("profile", "profile_find", "Find the fields for a photograph or for settings."),
    "export": ("profile", "profile_export", "Write a field as filters for another program."),
}
FORMATS = ("python", "imagemagick", "gmic", "rawtherapee")


@click.group(cls=LazyGroup, table=PROFILE_COMMANDS)
def profile() -> None:
    """Keep measured fields by camera, lens, aperture and focus, and export them."""


settings_options = options(
    click.option(
        "--library", type=PATH, help="Folder of the library.  [default: STATION_PROFILES, else in the user's data]"
    ),
    click.option("--camera", help="As its photographs record it."),
    click.option("--lens", help="As its photographs record it."),
    click.option("--f-number", type=FiniteNumber(min=0.1)),
    click.option("--focal-length-mm", type=FiniteNumber(min=0.1)),
    click.option("--focus-m", type=FiniteNumber(min=0.001), help="Distance of focus."),
)


def _settings(camera: str | None, lens: str | None, f_number: float | None, focal_length_mm: float | None,
              focus_m: float | None) -> Exposure:  # fmt: skip
    from procedures.raw import Exposure

    return Exposure(
        camera=camera, lens=lens, f_number=f_number, focal_length_mm=focal_length_mm,
        subject_distance_mm=None if focus_m is None else 1000 * focus_m,
    )  # fmt: skip


@command("add")
@click.argument("result", type=PATH)
@settings_options
@click.option("--replace", is_flag=True, help="Replace the profile with the same settings.")
def profile_add(result: Path, library: Path | None, replace: bool, **given: Any) -> None:
    """Add RESULT of `station psf field`, its folder or field.h5, to the library.

    The settings are those that the photographs record; options take precedence, as for adapted lenses.
    """
    from station.calibration.profiles import add_profile, library_folder

    added = add_profile(result, _settings(**given), library or library_folder(), replace=replace)
    log("added", f"added {added.path}", path=str(added.path))


@command("find", as_json=True)
@click.argument("photo", type=PATH, required=False)
@settings_options
def profile_find(photo: Path | None, library: Path | None, as_json: bool, **given: Any) -> None:
    """Find the fields for PHOTO, or for the settings given, the best first; all fields without either.

    `station correct PHOTO` without --field takes the first one.
    """
    from procedures.raw import read_frame
    from station.calibration.profiles import completed, find_profiles, library_folder, profiles
    from station.procedure.base import read_picture

    folder = library or library_folder()
    wanted = _settings(**given)
    if photo is not None:
        wanted = completed(wanted, read_picture(photo, None, read_frame).exposure)
    all_of_them = photo is None and not any(given.values())
    fitting = profiles(folder) if all_of_them else find_profiles(wanted, folder)
    if as_json:
        click.echo(
            json.dumps({"schema": "station/profiles/1", "profiles": [one.record() for one in fitting]}, indent=1)
        )
    elif fitting:
        head = ("profile", "camera", "lens", "f/", "focal length", "focus", "not compared")
        click.echo(columns([head, *(_row(one.record()) for one in fitting)]))
    else:
        log("profiles", f"the library {folder} is empty", root=str(folder))


def _row(record: dict[str, Any]) -> tuple[str, ...]:
    focal, focus = record["focal_length_mm"], record["subject_distance_mm"]
    return (
        record["path"], record["camera"] or "-", record["lens"] or "-", f"{record['f_number'] or 0:g}",
        f"{focal:g} mm" if focal else "-", f"{focus / 1000:g} m" if focus else "-",
        ", ".join(record["not_compared"]) or "-",
    )  # fmt: skip


@command("export")
@click.argument("result", type=PATH)
@click.option("--to", "form", type=click.Choice(FORMATS), required=True, help="The program.")
@click.option(
    "--noise-gain", type=FiniteNumber(min=1.01, max=100), default=3.0, show_default=True,
    help="Noise after the correction over that before, in the median over the frame.",
)  # fmt: skip
@click.option("--columns", type=click.IntRange(2, 64), default=9, show_default=True, help="Filters along the frame.")
@click.argument("out", type=PATH)
def profile_export(result: Path, form: str, noise_gain: float, columns: int, out: Path) -> None:
    """Write the field RESULT, of the library or of `station psf field`, as the file OUT for another program.

    python is a program that needs NumPy alone, imagemagick a shell script, gmic a command file for G'MIC and for its
    plug-in in GIMP: each convolves a developed picture of the whole frame with inverse filters at a grid of places.
    rawtherapee is a partial profile: radius and corner boost of its Capture Sharpening, which takes no kernels.
    """
    from procedures.correction.kernel_tiles import kernel_tiles
    from procedures.field.field_file import read_camera, read_field
    from station.calibration.exports.kernels import export_kernels
    from station.calibration.exports.psf import field_path

    path = field_path(result)
    exposure = read_camera(path)
    known = (
        [] if exposure is None else [exposure.camera, exposure.lens, exposure.f_number and f"f/{exposure.f_number:g}"]
    )
    tiles = kernel_tiles(read_field(path), noise_gain=noise_gain, columns=columns)
    write_export(export_kernels(tiles, form, ", ".join(str(one) for one in known if one) or path.name), path, out)
