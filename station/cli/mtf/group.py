"""`station mtf ...`: measurements of the MTF alone."""

from __future__ import annotations

import click

from station.cli.terminal.lazy import LazyGroup

# name -> (module under station.cli, function, help line)
MTF_COMMANDS = {"edge": ("procedure_command", "edge", "Across slanted edges, ISO 12233 e-SFR.")}


@click.group(cls=LazyGroup, table=MTF_COMMANDS)
def mtf() -> None:
    """Measure a modulation transfer function."""
