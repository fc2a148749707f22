"""`station psf series`: a lens over aperture, focus and ISO, from photographs of one mounting."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.batch import carry_out
from station.cli.psf.planes import chart_options, psf_options, told_layout
from station.cli.psf.terms import terms_of
from station.common.log import log

if TYPE_CHECKING:
    from procedures.reading.sensor_dump import DumpLayout


@click.command("series")
@click.argument("folder", type=click.Path(path_type=Path))
@chart_options
@click.option("--jobs", type=click.IntRange(1, 1024), help="Processes at a time.  [default: as many as cores]")
@click.option(
    "--physics/--no-physics", default=None,
    help="Also explain each PSF by photosites, low-pass filter, diffraction and aberrations, for the wavefront's error."
    "  [default: where --pixel-pitch-um is given]",
)  # fmt: skip
@psf_options(s="auto", k="auto", solver="ls")
def psf_series(
    folder: Path,
    bits: Path | None,
    seed: int | None,
    jobs: int | None,
    physics: bool | None,
    plane: str | None,
    layout: DumpLayout | None,
    out: Path,
    report: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Follow MTF50, Strehl ratio and wavefront over aperture, focus and ISO in FOLDER, photographs of the chart.

    The cameras' notes tell which is which; photographs of the same settings are put together. Writes series.csv and
    series.html beside what `station batch` writes: it is a batch with `procedure = "series"`, and goes on where it was
    stopped.
    """
    from station.batch.procedure_file import SERIES, Procedure
    from station.procedure.builtin.pattern import PatternSettings
    from station.procedure.settings import read_settings

    terms = terms_of(options)
    chosen = {name: value for name, value in {**options, "bits": bits, "seed": seed}.items() if value is not None}
    explained = "pixel_pitch_um" in chosen if physics is None else physics
    if not explained:
        remedy = "give --pixel-pitch-um for it, and for the Strehl ratio" if physics is None else ""
        log("physics", "no wavefront is looked for", remedy=remedy)
    chosen |= {"physics": explained, **told_layout(layout), **({"plane": plane} if plane else {})}
    settings = read_settings(PatternSettings, chosen)
    settings.check()
    procedure = Procedure(SERIES, None, terms=terms, settings=settings)
    carry_out(procedure, (folder,), out, jobs=jobs, reports=report, as_json=as_json)
