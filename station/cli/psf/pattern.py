"""`station psf pattern`: the PSF of each plane from one photograph of the noise chart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from station.cli.psf.planes import certificate_option, chart_options, chart_source, overlay_option, psf_options
from station.cli.psf.request import Request


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
    image: Path, bits: Path | None, seed: int | None, physics: bool, sensor: Path | None, **options: Any
) -> None:
    """Estimate the PSF from IMAGE, a photograph of the noise chart."""
    request = Request.taken_from(options, "pattern")
    from procedures.pattern_psf.estimate import PatternParameters
    from station.calibration.planes import calibrate
    from station.calibration.sensor_models import NO_SENSOR, read_sensor

    parameters = PatternParameters(**options)
    with request.folder() as folder:
        source = chart_source(bits, seed)
        frame = request.read(image)
        parameters = request.at_frequencies(parameters, frame)
        known = read_sensor(sensor, frame) if sensor else NO_SENSOR
        limit = request.limit_of(frame, needed=physics)
        found = calibrate(frame, source.chart, parameters, limit, physics=physics, sensor=known)
        given = {**parameters.to_record(), "physics": physics, **known.told(), "chart": source.origin}
        request.answer(folder, [frame], found, given)
