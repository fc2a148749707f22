"""`station psf pattern`: the PSF of each plane from one photograph of the noise chart."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.planes import OPTICS, finish, psf_options, read_planes, tell_each, write_result

if TYPE_CHECKING:
    from procedures.pattern_print.source import Source


@click.command("pattern")
@click.argument("image", type=click.Path(path_type=Path))
@click.option("--bits", type=click.Path(path_type=Path), help="The chart's 256 x 256 cells as a grey image.")
@click.option(
    "--seed", type=click.IntRange(0, 2**63 - 1), help="The chart's seed; 1 if neither this nor --bits is given."
)
@psf_options(s=4, k=17, solver="ls")
def psf_pattern(
    image: Path,
    bits: Path | None,
    seed: int | None,
    plane: str | None,
    out: Path,
    report: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Estimate the PSF from IMAGE, a photograph of the noise chart."""
    start = time.perf_counter()
    if bits is not None and seed is not None:
        raise click.UsageError("the chart comes from --bits or from --seed; give one of them")
    from procedures.pattern_psf.estimate import PatternParameters
    from station.calibrate import calibrate, diffraction_limit
    from station.results import ResultFolder

    optics = {name: options.pop(name) for name in OPTICS}
    parameters = PatternParameters(**options)
    with ResultFolder(out) as folder:
        source = _chart(bits, seed)
        frame = read_planes(image, plane)
        limit = partial(diffraction_limit, frame.exposure, **optics)
        planes = tell_each(calibrate(frame, source.chart, parameters, limit))
        given = {**options, "chart": source.origin, **{k: v for k, v in optics.items() if v is not None}}
        text = write_result(folder, planes, "pattern", [frame], parameters=given, report=report, start=start)
    finish(planes, text, as_json=as_json)


def _chart(bits: Path | None, seed: int | None) -> Source:
    from procedures.pattern import DEFAULT_SEED
    from procedures.pattern_print.source import Source

    return Source.from_file(bits) if bits else Source.from_seed(DEFAULT_SEED if seed is None else seed)
