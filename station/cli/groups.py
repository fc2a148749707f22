"""`station psf ...` and `station mtf ...`: procedures in groups."""

import click

from station.cli.terminal.lazy import LazyGroup

# name -> (module under station.cli, function, help line)
PSF_COMMANDS = {
    "pattern": ("procedure_command", "pattern", "From one photograph of the noise chart."),
    "witnessed": ("procedure_command", "witnessed", "From one photograph of the noise chart with three witnesses."),
    "two-photo": ("procedure_command", "two-photo", "From two photographs of a wall at different distances."),
    "series": ("procedure_command", "series", "Over aperture, focus and ISO, from one mounting."),
    "stability": ("procedure_command", "stability", "How far repeated PSFs agree, over regions of frequencies."),
    "field": ("procedure_command", "field", "Over the whole frame, from charts at many places."),
}
MTF_COMMANDS = {"edge": ("procedure_command", "edge", "Across slanted edges, ISO 12233 e-SFR.")}


@click.group(cls=LazyGroup, table=PSF_COMMANDS)
def psf() -> None:
    """Estimate a point spread function."""


@click.group(cls=LazyGroup, table=MTF_COMMANDS)
def mtf() -> None:
    """Measure a modulation transfer function."""
