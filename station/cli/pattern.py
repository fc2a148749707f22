"""`station pattern`: the printable noise chart."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from procedures.pattern_print.sheet import PAPERS, paper_named, papers_of_locale
from station.cli.terminal.command import PATH, SEED, FiniteNumber, command

if TYPE_CHECKING:
    from procedures.pattern_psf.pose import ImagingGeometry


@command("pattern", log_json=False)
@click.argument("out", type=PATH, metavar="OUT.{pdf,svg,png,pgm}")
@click.option(
    "--paper",
    type=click.Choice(list(PAPERS), case_sensitive=False),
    help="Of the printer.  [default: that of the locale]",
)
@click.option("--tile", is_flag=True, help="Print over several sheets of the paper, to be joined; PDF only.")
@click.option(
    "--width-mm",
    type=FiniteNumber(),
    help="Width of the whole chart, ten blocks, in mm. Without --paper it determines the paper.  [default: as the "
    "paper allows; with --tile 300]",
)
@click.option("--seed", type=SEED, help="Cells from this seed.  [default: 1 without --bits]")
@click.option("--bits", type=PATH, metavar="FILE.pgm", help="Cells from a black and white 256x256 image.")
@click.option(
    "--edges", is_flag=True, help="Two slanted edges next to the chart, for a cross-check of each calibration."
)
@click.option(
    "--cell-pixels", type=int, default=8, show_default=True, help="Pixels along a cell, for PNG and PGM: 1 to 32."
)
@click.option(
    "--focal-length-mm", type=FiniteNumber(min=1), help="Of the lens: lists the noise amplification at each distance."
)
@click.option("--pixel-pitch-um", type=FiniteNumber(min=0.1), help="Of the sensor, with --focal-length-mm.")
@click.option("--f-number", type=FiniteNumber(min=0.1), help="Of the aperture, with both.")
@click.option("--monochrome", is_flag=True, help="The sensor has no colour mosaic.")
def pattern(
    out: Path, paper: str | None, tile: bool, width_mm: float | None, seed: int | None, bits: Path | None,
    edges: bool, cell_pixels: int, focal_length_mm: float | None, pixel_pitch_um: float | None,
    f_number: float | None, monochrome: bool,
) -> None:  # fmt: skip
    """Write the noise chart to OUT.

    PDF and SVG are pages with rulers, advice and distances, for printing at 100 %; PNG and PGM are the chart alone
    with a white margin. With --tile the PDF begins with an assembly drawing. Given a lens, stderr shows the noise
    amplification at each distance.
    """
    if seed is not None and bits is not None:
        raise click.UsageError("--seed and --bits both define the cells; give one of them")
    if (focal_length_mm is None) != (pixel_pitch_um is None) or (f_number is not None and focal_length_mm is None):
        raise click.UsageError(
            "distances require --focal-length-mm and --pixel-pitch-um together; --f-number requires both"
        )
    # imported here: reportlab is slow to import
    from procedures.pattern import DEFAULT_SEED
    from procedures.pattern_print.distance import PHOTOSITES_PER_PIXEL
    from procedures.pattern_print.formats import check_ending, encode
    from procedures.pattern_print.sheet import Size, largest_width_mm, smallest_paper
    from procedures.pattern_print.source import Source
    from procedures.pattern_print.tile_sheets import AUTHORS_WIDTH_MM
    from procedures.pattern_psf.pose import ImagingGeometry
    from station.common.durable_files import write_whole

    check_ending(out)
    usual = papers_of_locale(os.environ)
    chosen = paper_named(paper) if paper else usual[0]
    if width_mm is None:
        size = Size(AUTHORS_WIDTH_MM if tile else largest_width_mm(chosen, edges))
    else:
        size = Size(width_mm)
        chosen = chosen if paper or tile else smallest_paper(usual, size, edges)
    source = Source.from_file(bits) if bits else Source.from_seed(DEFAULT_SEED if seed is None else seed)
    source = source.with_edges() if edges else source
    encoded = encode(out, source, size, cell_pixels, chosen, tile=tile)
    write_whole(out, encoded.data)
    click.echo(f"{out}: {encoded.extent}; {source.origin}; {size}", err=True)
    if focal_length_mm is not None and pixel_pitch_um is not None:
        pitch_um = pixel_pitch_um * (1 if monochrome else PHOTOSITES_PER_PIXEL)
        _explain(ImagingGeometry(focal_length_mm, pitch_um, size.cell_mm), f_number)


def _explain(optics: ImagingGeometry, f_number: float | None) -> None:
    from procedures.choice import START_K, START_S
    from procedures.pattern_psf.facts import RATIO
    from procedures.pattern_psf.gamma import gamma_diagram
    from procedures.quality import WAVELENGTHS_NM, Diffraction
    from station.drawing.diagrams import diagram_lines
    from station.drawing.glyphs import glyphs_for

    limit = Diffraction(f_number, optics.plane_pitch_um, WAVELENGTHS_NM["G"]) if f_number is not None else None
    ascii = glyphs_for(os.environ, sys.stderr.encoding).ascii
    for line in diagram_lines(gamma_diagram(optics, START_S, START_K, RATIO, limit), ascii=ascii):
        click.echo(line, err=True)
