"""`station psf two-photo`: the PSF of each plane from two photographs of a wall at different distances."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import click

from station.cli.planes import OPTICS, finish, psf_options, read_planes, tell_each, write_result


@click.command("two-photo")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@psf_options(s="auto", k="auto", solver="ls")
def psf_two_photo(a: Path, b: Path, plane: str | None, out: Path, report: bool, as_json: bool, **options: Any) -> None:
    """Estimate the PSF from A and B, photographs of one textured wall at distances more than s times apart."""
    start = time.perf_counter()
    from procedures.two_photo.estimate import TwoPhotoParameters
    from station.calibrate import calibrate_pair, diffraction_limit
    from station.results import ResultFolder

    optics = {name: options.pop(name) for name in OPTICS}
    parameters = TwoPhotoParameters(**options)
    with ResultFolder(out) as folder:
        first, second = read_planes(a, plane), read_planes(b, plane)
        limit = partial(diffraction_limit, first.exposure, **optics)
        planes = tell_each(calibrate_pair(first, second, parameters, limit))
        given = {**parameters.told(), **{k: v for k, v in optics.items() if v is not None}}
        text = write_result(folder, planes, "two-photo", [first, second], parameters=given, report=report, start=start)
    finish([one.record for one in planes], text, as_json=as_json)
