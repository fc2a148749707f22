"""`station psf two-photo`: the PSF of each plane from two photographs of a wall at different distances."""

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


@click.command("two-photo")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@certificate_option
@overlay_option
@psf_options(s="auto", k="auto", solver="ls")
def psf_two_photo(
    a: Path,
    b: Path,
    plane: str | None,
    layout: DumpLayout | None,
    out: Path,
    report: bool,
    certificate: bool,
    overlays: tuple[Path, ...],
    as_json: bool,
    **options: Any,
) -> None:
    """Estimate the PSF from A and B, photographs of one textured wall at distances more than s times apart."""
    start = time.perf_counter()
    from procedures.two_photo.estimate import TwoPhotoParameters
    from station.calibration.planes import calibrate_pair, diffraction_limit
    from station.results.result_files import ResultFolder
    from station.results.units import pixels_of

    trusted, terms, others = options.pop("trust_typed"), terms_of(options), read_overlays(overlays)
    optics = {name: options.pop(name) for name in OPTICS}
    parameters = TwoPhotoParameters(**options)
    with ResultFolder(out, force=forced()) as folder:
        typed = None if trusted else optics
        first, second = (read_planes(image, plane, layout, typed=typed) for image in (a, b))
        pixels = pixels_of(first, optics["pixel_pitch_um"])
        parameters = replace(parameters, at=terms.frequencies(next(iter(pixels.values()))))
        limit = partial(diffraction_limit, first.exposure, **optics)
        found = calibrate_pair(first, second, parameters, limit)
        planes = tell_each(terms.told(one, pixels[one.name]) for one in found)
        given = {**parameters.told(), **{k: v for k, v in optics.items() if v is not None}, **told_layout(layout)}
        given |= told_trust(trusted)
        text = write_result(
            folder,
            planes,
            "two-photo",
            [first, second],
            parameters=given,
            terms=terms,
            report=report or bool(others),
            certificate=certificate,
            start=start,
            overlays=others,
        )
    finish(planes, text, as_json=as_json)
