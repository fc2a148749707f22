"""`station psf two-photo`: the PSF of each plane from two photographs of a wall at different distances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from station.cli.psf.planes import certificate_option, overlay_option, psf_options
from station.cli.psf.request import Request


@click.command("two-photo")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@certificate_option
@overlay_option
@psf_options(s="auto", k="auto", solver="ls")
def psf_two_photo(a: Path, b: Path, **options: Any) -> None:
    """Estimate the PSF from A and B, photographs of one textured wall at distances more than s times apart."""
    request = Request.taken_from(options, "two-photo")
    from procedures.two_photo.estimate import TwoPhotoParameters
    from station.calibration.planes import calibrate_pair

    parameters = TwoPhotoParameters(**options)
    with request.folder() as folder:
        first, second = request.read(a), request.read(b)
        parameters = request.at_frequencies(parameters, first)
        found = calibrate_pair(first, second, parameters, request.limit_of(first))
        request.answer(folder, [first, second], found, parameters.to_record())
