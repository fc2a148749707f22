"""Options of the bench that commands inherit from the program: its configuration, or the simulated one."""

from __future__ import annotations

from pathlib import Path

import click

from station.cli.terminal.inherited import inherited
from station.cli.terminal.numbers import SEED

CONFIG = Path("station.toml")
"""Read where no other file is named."""


def usual_config() -> Path | None:
    """station.toml, where there is one."""
    return CONFIG if CONFIG.is_file() else None


def existing_file(context: click.Context, option: click.Parameter, path: Path | None) -> Path | None:
    """The file of an option, which must be there: no other is read in its place."""
    if path is not None and not path.exists():
        raise click.BadParameter(
            f"there is no {path}; name a file that exists, or leave the option out", context, option
        )
    return path


config_option = inherited(
    "--config", type=click.Path(path_type=Path), callback=existing_file,
    help="The bench's devices.  [default: station.toml where there is one]",
)  # fmt: skip
simulate_option = inherited("--simulate", is_flag=True, help="Work with the simulated bench.")
seed_option = inherited("--seed", type=SEED, default=0, show_default=True, help="Of the simulated bench.")
shaker_option = inherited("--shaker", is_flag=True, help="With --simulate: the bench has a shaker.")


def check_shaker(*, simulate: bool, shaker: bool) -> None:
    """Raises UsageError where a real bench is asked for a simulated shaker."""
    if shaker and not simulate:
        raise click.UsageError("--shaker is of the simulated bench: give --simulate, or write [devices.shaker]")
