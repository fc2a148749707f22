"""Options of bench and sessions that commands inherit from the program."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.terminal.command import PATH, SEED, FiniteNumber
from station.cli.terminal.inherited import inherited
from station.common.durable_files import check_writable

if TYPE_CHECKING:
    from station.guide.workspace import StationLab

CONFIG = Path("station.toml")


def usual_config() -> Path | None:
    """station.toml, if it exists."""
    return CONFIG if CONFIG.is_file() else None


def existing_file(context: click.Context, option: click.Parameter, path: Path | None) -> Path | None:
    """The file of an option, which must exist."""
    if path is not None and not path.exists():
        raise click.BadParameter(f"there is no {path}; name an existing file, or omit the option", context, option)
    return path


config_option = inherited(
    "--config", type=PATH, callback=existing_file,
    help="The bench's devices.  [default: station.toml where there is one]",
)  # fmt: skip
simulate_option = inherited("--simulate", is_flag=True, help="Work with the simulated bench.")
seed_option = inherited("--seed", type=SEED, default=0, show_default=True, help="Of the simulated bench.")
shaker_option = inherited("--shaker", is_flag=True, help="With --simulate: the bench has a shaker.")

speed_option = inherited(
    "--speed", type=FiniteNumber(min=0.1, max=1000.0), default=1.0, show_default=True,
    help="With --simulate: how many times as fast as real ones its moves are.",
)  # fmt: skip


def check_shaker(*, simulate: bool, shaker: bool) -> None:
    """Raises UsageError for the simulated shaker on a real bench."""
    if shaker and not simulate:
        raise click.UsageError("--shaker is for the simulated bench: give --simulate, or write [devices.shaker]")


def make_lab(
    *, simulate: bool, shaker: bool, config: Path | None, sessions: Path, seed: int, specification: Path | None,
    unit: str | None, speed: float = 1.0,
) -> StationLab:  # fmt: skip
    """Bench and sessions by a command's options. Raises UsageError, and BadParameter for an invalid specification or an
    unwritable folder."""
    from station.guide.catalogue import entries
    from station.guide.workspace import StationLab
    from station.results.specification_file import read_specification

    check_shaker(simulate=simulate, shaker=shaker)
    check_writable(sessions)
    if speed != 1.0 and not simulate:
        raise click.UsageError("--speed is for the simulated bench: give --simulate, or leave --speed out")
    if specification is not None:
        entries()  # loads the procedures of installed packages, whose numbers may have limits
        read_specification(specification)
    return StationLab(
        sessions=sessions, config=config or usual_config(), simulate=simulate, seed=seed, specification=specification,
        shaker=shaker, unit=frozen_unit(unit, config), speed=speed,
    )  # fmt: skip


def frozen_unit(name: str | None, config: Path | None) -> str | None:
    """The unit of frequencies in new sessions, by option or station.toml; None for the default one."""
    from station.results.specification_file import preferred_unit
    from station.results.units import Unit

    unit = Unit(name.lower()) if name else preferred_unit(config)
    return None if unit is Unit.CYCLES else str(unit)
