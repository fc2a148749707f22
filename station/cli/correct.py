"""`station correct`: photographs through the measured field of their lens, undone."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.psf.planes import raw_option, tell_judged, told_layout
from station.cli.terminal.force import force_option, forced
from station.cli.terminal.numbers import Number
from station.cli.terminal.progress import progress
from station.common.errors import REFUSED
from station.common.log import log, log_json_option
from station.results.record_head import InputFile, RecordHead

if TYPE_CHECKING:
    from procedures.reading.sensor_dump import DumpLayout
    from station.common.progress import Progress


def _by_hundredths(told: Progress) -> Callable[[int, int], None]:
    """Hundredths of the work, from the number of tiles done and of all."""
    last = 0

    def heard(done: int, of: int) -> None:
        nonlocal last
        if (now := 100 * done // of) > last:
            told(f"{done} of {of} tiles", now - last)
            last = now

    return heard


@click.command("correct")
@click.argument("photos", metavar="PHOTO...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--field",
    "field",
    type=click.Path(path_type=Path),
    required=True,
    help="What `station psf field` wrote: its folder, or field.h5 in it.",
)
@click.option(
    "--prior", type=click.Choice(["total-variation", "second-order"]), default="total-variation", show_default=True
)
@click.option(
    "--strength", type=Number(0.01, 100), default=1.0, show_default=True,
    help="Of the prior; 1 is what the photograph's noise asks for.",
)  # fmt: skip
@click.option("--iterations", type=click.IntRange(1, 500), default=12, show_default=True)
@click.option(
    "--scale", type=click.IntRange(1, 4), default=1, show_default=True,
    help="Pixels of the picture per pixel of the sensor, along each side: more than 1 asks for several photographs.",
)  # fmt: skip
@click.option(
    "--tile-px", type=click.Choice(["128", "192", "256", "384", "512"]), help="[default: as the field varies]"
)
@click.option("--insist", is_flag=True, help="Take a field whatever camera, lens, aperture and focus it is of.")
@raw_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@force_option
@log_json_option
def correct(
    photos: tuple[Path, ...],
    field: Path,
    prior: str,
    strength: float,
    iterations: int,
    scale: int,
    tile_px: str | None,
    insist: bool,
    layout: DumpLayout | None,
    out: Path,
    as_json: bool,
) -> None:
    """Sharpen PHOTO by the PSF field of its lens: RAW with a 2 x 2 mosaic, or one linear grey plane.

    Demosaicking, deblurring and lateral colour are undone as one problem, as strongly as the photograph's noise allows.
    Several photographs of one scene, moved by some pixels, become one picture, with --scale 2 of twice as many pixels.
    """
    start = time.perf_counter()
    from dataclasses import replace

    from procedures.correction.estimate import CorrectionParameters
    from procedures.correction.priors import Prior
    from station.calibration.correction import correct_photographs, write_correction, write_refusal
    from station.calibration.exports.psf import field_path
    from station.reports.correction_page import correction_page
    from station.results.result_files import ResultFolder

    usual = CorrectionParameters()
    parameters = replace(
        usual,
        prior=Prior(prior, strength=strength),
        splitting=replace(usual.splitting, iterations=iterations),
        side=int(tile_px) if tile_px else None,
        scale=scale,
    )
    with ResultFolder(out, force=forced()) as folder, progress(100) as told:
        found = correct_photographs(
            photos, field_path(field), parameters, layout, _by_hundredths(told), insisted=insist
        )
        given = {"prior": prior, "strength": strength, "iterations": iterations, "field": str(field)}
        given |= {"scale": scale} if scale > 1 else {}
        given |= {"tile_px": tile_px or "auto", **told_layout(layout), **({"insist": True} if insist else {})}
        duration_s = round(time.perf_counter() - start, 3)
        inputs = tuple(InputFile(str(one.path), one.sha256) for one in (found.frame, *found.others))
        head = RecordHead("correct", inputs, given, duration_s=duration_s)
        if found.outcome.value is None:
            text = write_refusal(folder, found, head)
        else:
            text = write_correction(folder, found, head, correction_page(found, head))
    outcome = found.outcome
    places = outcome.value.places if outcome.value else ()
    used = 1 + sum(not place.reason for place in places)
    done = "the photograph is corrected" if len(photos) == 1 else f"one picture of {used} photographs is made"
    sentence = f"{outcome.verdict}: {outcome.reason or done}"
    for frame, place in zip(found.others, places, strict=bool(places)):
        if place.reason:
            log("set aside", f"{frame.path.name} is set aside: {place.reason}", level="warning", remedy=place.remedy)
    tell_judged("corrected", sentence, outcome)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if outcome.value is None:
        raise click.exceptions.Exit(REFUSED)
