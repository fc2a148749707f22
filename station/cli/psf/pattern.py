"""`station psf pattern`: the PSF of each plane from one photograph of the noise chart."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.planes import (
    OPTICS,
    certificate_option,
    chart_options,
    chart_source,
    finish,
    overlay_option,
    psf_options,
    read_overlays,
    read_planes,
    tell_each,
    told_layout,
    told_trust,
    write_result,
)
from station.cli.psf.terms import terms_of
from station.cli.terminal.force import forced

if TYPE_CHECKING:
    from procedures.reading.sensor_dump import DumpLayout


@click.command("pattern")
@click.argument("image", type=click.Path(path_type=Path))
@chart_options
@click.option(
    "--physics", is_flag=True, help="Also explain the PSF by photosites, low-pass filter, diffraction and aberrations."
)
@click.option(
    "--sensor",
    type=click.Path(path_type=Path),
    metavar="RESULT.json",
    help="Of station sensor: its response is undone, its noise weighs the samples.",
)
@certificate_option
@overlay_option
@psf_options(s="auto", k="auto", solver="ls")
def psf_pattern(
    image: Path,
    bits: Path | None,
    seed: int | None,
    physics: bool,
    sensor: Path | None,
    plane: str | None,
    layout: DumpLayout | None,
    out: Path,
    report: bool,
    certificate: bool,
    overlays: tuple[Path, ...],
    as_json: bool,
    **options: Any,
) -> None:
    """Estimate the PSF from IMAGE, a photograph of the noise chart."""
    start = time.perf_counter()
    from procedures.pattern_psf.estimate import PatternParameters
    from station.calibration.planes import calibrate, diffraction_limit
    from station.calibration.sensor_models import NO_SENSOR, read_sensor
    from station.results.result_files import ResultFolder
    from station.results.units import pixels_of

    trusted, terms, others = options.pop("trust_typed"), terms_of(options), read_overlays(overlays)
    optics = {name: options.pop(name) for name in OPTICS}
    parameters = PatternParameters(**options)
    with ResultFolder(out, force=forced()) as folder:
        source = chart_source(bits, seed)
        frame = read_planes(image, plane, layout, typed=None if trusted else optics)
        pixels = pixels_of(frame, optics["pixel_pitch_um"])
        parameters = replace(parameters, at=terms.frequencies(next(iter(pixels.values()))))
        known_sensor = read_sensor(sensor, frame) if sensor else NO_SENSOR
        limit = partial(diffraction_limit, frame.exposure, **optics)
        found = calibrate(frame, source.chart, parameters, limit, physics=physics, sensor=known_sensor)
        planes = tell_each(terms.told(one, pixels[one.name]) for one in found)
        known = {name: value for name, value in optics.items() if value is not None}
        given = {
            **parameters.told(),
            "physics": physics,
            **known_sensor.told(),
            "chart": source.origin,
            **known,
            **told_layout(layout),
            **told_trust(trusted),
        }
        text = write_result(
            folder,
            planes,
            "pattern",
            [frame],
            parameters=given,
            terms=terms,
            report=report or bool(others),
            certificate=certificate,
            start=start,
            overlays=others,
        )
    finish(planes, text, as_json=as_json)
