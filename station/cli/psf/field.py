"""`station psf field`: the PSF of each plane over the whole frame, from photographs of charts at many places."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.photosite_option import photosite_option, told_photosite
from station.cli.psf.planes import (
    INSIST,
    OPTICS,
    certificate_option,
    chart_options,
    chart_source,
    finish,
    psf_options,
    tell_each,
    tell_misses,
    told_layout,
    told_trust,
)
from station.cli.psf.terms import terms_of
from station.cli.terminal.force import forced
from station.cli.terminal.numbers import Number
from station.cli.terminal.progress import progress
from station.common.errors import FAILED_ITEMS
from station.common.log import log

if TYPE_CHECKING:
    from procedures.field.photosite import Photosite
    from procedures.reading.sensor_dump import DumpLayout


@click.command("field")
@click.argument("folder", type=click.Path(path_type=Path))
@chart_options
@click.option(
    "--focus", type=click.Path(path_type=Path), help="A CSV table: photograph's name, focus position in mm (a bracket)."
)
@click.option(
    "--vignetting", type=click.Path(path_type=Path), help="A result of station vignetting, to be kept with the field."
)
@photosite_option
@click.option(
    "--overlay",
    "overlays",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="RESULT",
    help="Draw the MTF over image height of this field or session over the page's too; as often as wanted.",
)
@click.option(
    "--sensor",
    type=click.Path(path_type=Path),
    metavar="RESULT.json",
    help="Of station sensor: its response is undone, its noise weighs the samples; gain and noise are reported with "
    "the camera.",
)
@click.option(
    "--width-mm",
    type=Number(min=1),
    default=300.0,
    show_default=True,
    help="Width of the printed chart's ten blocks: the distances of the geometry hang on it.",
)
@certificate_option
@psf_options(s=4, k="auto", solver="ls", report=True)
def psf_field(
    folder: Path,
    bits: Path | None,
    seed: int | None,
    focus: Path | None,
    vignetting: Path | None,
    photosite: Photosite | None,
    overlays: tuple[Path, ...],
    sensor: Path | None,
    width_mm: float,
    plane: str | None,
    layout: DumpLayout | None,
    out: Path,
    report: bool,
    certificate: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Estimate the PSF over the frame from FOLDER: photographs of one or several charts each, or a session.

    All planes are estimated unless --plane names one. What else the charts tell (geometry, lateral colour) is written
    with the PSF's numbers, and with those of --vignetting and --sensor, as one file with one covariance, camera.h5.
    """
    start = time.perf_counter()
    source = chart_source(bits, seed)
    from procedures.field.conclusion import conclude
    from procedures.field.measuring import measure
    from procedures.pattern import BLOCK, BLOCKS
    from procedures.pattern_psf.estimate import PatternParameters
    from procedures.whole_camera.from_field import whole_camera
    from station.calibration.field import field_pixels, field_results
    from station.calibration.field_photographs import check_noted, focus_positions, photographs
    from station.calibration.planes import diffraction_limit
    from station.calibration.sensor_models import read_models
    from station.calibration.vignetting import read_vignetting
    from station.calibration.whole_camera import other_parts
    from station.reports.field.field_files import write_field_result
    from station.results.overlay import read_height_overlays
    from station.results.result_files import ResultFolder
    from station.results.units import Pixels

    trusted, terms = options.pop("trust_typed"), terms_of(options)
    optics = {name: options.pop(name) for name in OPTICS}
    parameters = PatternParameters(**options)
    paths = photographs(folder)
    if not trusted:
        check_noted(paths, optics, INSIST)
    positions = focus_positions(focus, paths) if focus else None
    lights = {name: one.light for name, one in read_vignetting(vignetting).items()} if vignetting else {}
    # what cannot be read is told before the work, not after it
    drawn_over = read_height_overlays(overlays, terms.unit)
    others, sensors = other_parts(vignetting, sensor), read_models(sensor, paths) if sensor else {}
    names = None if plane in (None, "all") else [str(plane)]
    with ResultFolder(out, force=forced()) as results, progress(len(paths)) as told:
        measured = measure(paths, names, source.chart, parameters, told, layout, sensors=sensors)
        tell_misses(measured.misses)
        exposure = measured.exposures[0].exposure if measured.exposures else None
        limit = partial(diffraction_limit, exposure, **optics) if exposure else (lambda plane: None)
        pixels = field_pixels(measured, optics["pixel_pitch_um"])
        at = terms.frequencies(next(iter(pixels.values()), Pixels()))
        found = conclude(measured, positions, limit, at=at, photosite=photosite)
        planes = field_results(found, terms, pixels, limit)
        beside = {name: str(path) for name, path in {"vignetting": vignetting, "sensor": sensor}.items() if path}
        given = {**options, "chart": source.origin, **told_optics(optics), **beside, **told_photosite(photosite)}
        camera = whole_camera(found, width_mm / (BLOCK * BLOCKS), others)
        text = write_field_result(
            results, found, planes, terms, report=report, certificate=certificate, start=start, lights=lights,
            overlays=drawn_over, camera=camera, parameters={**given, **told_layout(layout), **told_trust(trusted)},
        )  # fmt: skip
    tell_each(planes)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    finish(planes, text, as_json=as_json)
    if measured.failed:
        raise click.exceptions.Exit(FAILED_ITEMS)


def told_optics(optics: dict[str, float | None]) -> dict[str, float]:
    """What is known of lens and pixels."""
    return {name: value for name, value in optics.items() if value is not None}
