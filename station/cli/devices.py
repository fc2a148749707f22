"""`station devices`: what is configured, what answers, and what is wrong with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.terminal.columns import columns
from station.cli.terminal.numbers import SEED
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from station.bench.opening import Row

FAILED = 3
"""The exit code of device errors."""


@click.command()
@click.option("--config", type=click.Path(path_type=Path), default=Path("station.toml"), show_default=True)
@click.option("--simulate", is_flag=True, help="Show the simulated bench instead.")
@click.option("--seed", type=SEED, default=0, help="Of the simulated bench.")
@click.option("--faults", is_flag=True, help="Let the simulated bench fail now and then.")
@click.option("--wire-log", type=click.Path(path_type=Path), help="Write every byte on the wires to this folder.")
@click.option("--json", "as_json", is_flag=True, help="Write the rows as JSON to stdout.")
@log_json_option
def devices(config: Path, simulate: bool, seed: int, faults: bool, wire_log: Path | None, as_json: bool) -> None:
    """Show each device: driver, address, what answered, its state, and what to do where something is wrong."""
    from station.bench.opening import make_bench, read_config, simulated_bench
    from station.common.leftovers import temporary_folder
    from station.common.stop_signals import guarded

    with temporary_folder() as folder:
        if wire_log is not None:
            wire_log.mkdir(parents=True, exist_ok=True)
        if simulate:
            bench = simulated_bench(folder, seed=seed, faults=faults)
        else:
            bench = make_bench(read_config(config), folder=config.resolve().parent, wire_log=wire_log)
        try:
            with guarded(bench.emergency_stop, interrupt):
                rows = bench.rows()
        finally:
            bench.close()
    click.echo(json.dumps([entry(row) for row in rows], indent=1) if as_json else table(rows))
    wrong = [row for row in rows if row.error is not None]
    for row in rows:
        if row.condition.doubt is not None:
            log(
                "doubt", f"{row.name}: {row.condition.doubt.reason}", level="warning", remedy=row.condition.doubt.remedy
            )
    for row in wrong:
        assert row.error is not None
        log("device", f"{row.name}: {row.error.reason}", level="error", remedy=row.error.remedy)
    if wrong:
        raise click.exceptions.Exit(FAILED)


def interrupt() -> None:
    """Nothing is finished first: nothing moves here."""
    raise KeyboardInterrupt


def entry(row: Row) -> dict[str, Any]:
    """One row for programs."""
    who, error = row.identity, row.error
    return {
        "name": row.name,
        "driver": row.driver,
        "address": row.address,
        "model": who.model if who else None,
        "firmware": who.firmware if who else None,
        "serial": who.serial if who else None,
        "state": row.condition.word,
        "usable": row.condition.usable and error is None,
        "wrong": error.reason if error else None,
        "remedy": error.remedy if error else row.condition.remedy or None,
        "doubt": f"{doubt.reason}: {doubt.remedy}" if (doubt := row.condition.doubt) else None,
    }


def table(rows: list[Row]) -> str:
    """The rows for people: aligned columns; where a device may not be used yet, what to do."""
    cells = [["device", "driver", "answers as", "firmware", "serial", "state", "what to do"]]
    for row in rows:
        told = entry(row)
        words = [str(told[key] or "-") for key in ("model", "firmware", "serial", "state", "remedy")]
        cells.append([row.name, row.driver, *(words if row.error is None else ["-", "-", "-", "absent", "see below"])])
    return columns(cells)
