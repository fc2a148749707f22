"""`station pattern`: the printable noise chart."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.{pdf,svg,png,pgm}")
@click.option(
    "--width-mm", type=float, default=300.0, show_default=True, help="Width of the whole chart, ten blocks, in mm."
)
@click.option(
    "--seed", type=click.IntRange(0, 2**63 - 1), help="Cells from this seed; 1 if neither this nor --bits is given."
)
@click.option(
    "--bits", type=click.Path(path_type=Path), metavar="FILE.pgm", help="Cells from a black and white 256x256 image."
)
@click.option("--edges", is_flag=True, help="Two slanted edges beside the chart: each calibration is cross-checked.")
@click.option(
    "--cell-pixels", type=int, default=8, show_default=True, help="Pixels along a cell, for PNG and PGM: 1 to 32."
)
def pattern(out: Path, width_mm: float, seed: int | None, bits: Path | None, edges: bool, cell_pixels: int) -> None:
    """Write the noise chart to OUT.

    PDF and SVG are a page with rulers, advice and distances, to be printed at 100 %; PNG and PGM are the chart alone
    in its white margin.
    """
    if seed is not None and bits is not None:
        raise click.UsageError("--seed and --bits both choose the cells; give one of them")
    # imported here: the help of all commands must not wait for reportlab
    from procedures.pattern import DEFAULT_SEED
    from procedures.pattern_print.formats import check_ending, encode
    from procedures.pattern_print.sheet import Size
    from procedures.pattern_print.source import Source
    from station.files import write_whole

    check_ending(out)
    size = Size(width_mm)
    source = Source.from_file(bits) if bits else Source.from_seed(DEFAULT_SEED if seed is None else seed)
    source = source.with_edges() if edges else source
    encoded = encode(out, source, size, cell_pixels)
    write_whole(out, encoded.data)
    click.echo(f"{out}: {encoded.extent}; {source.origin}; {size}", err=True)
