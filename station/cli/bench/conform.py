"""`station conform`: whether a stage's driver keeps its promises, at its twin or at a real port."""

from __future__ import annotations

import json
from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.bench.devices import FAILED, interrupt
from station.cli.terminal.bench_options import CONFIG, config_option
from station.cli.terminal.columns import columns
from station.cli.terminal.inherited import inherited
from station.cli.terminal.numbers import SEED

if TYPE_CHECKING:
    from station.bench.conform import StageRig


@click.command()
@click.argument("driver")
@click.option("--port", help="Try it at this port; the stage moves along its whole travel.  [default: its twin]")
@config_option
@click.option(
    "--operations", type=click.IntRange(5, 100_000), default=500, show_default=True, help="Length of the random soak."
)
@inherited("--seed", type=SEED, default=0, show_default=True, help="Of the random operations and faults.")
@click.option("--json", "as_json", is_flag=True, help="Write the findings as JSON to stdout.")
def conform(driver: str, port: str | None, config: Path | None, operations: int, seed: int, as_json: bool) -> None:
    """Try the DRIVER of a stage: promises, stop latency, faults of the line, random operation.

    At its twin, time is simulated and the line fails on purpose. With --port a real stage is moved, without faults; its
    other options are those of the table with this driver in station.toml.
    """
    from station.bench.conform import at_twin
    from station.bench.conform import conform as findings_of
    from station.common.leftovers import temporary_folder
    from station.common.stop_signals import guarded

    with temporary_folder() as folder:
        place = at_twin(driver, folder) if port is None else _at_port(driver, port, config or CONFIG, folder)
        with place as rig, guarded(rig.stage.emergency_stop, interrupt):
            findings = []
            for finding in findings_of(rig, operations=operations, seed=seed):
                findings.append(finding)
                if not as_json:
                    click.echo(f"{finding.trial}: {'kept' if finding.kept else 'BROKEN'}", err=True)
    if as_json:
        click.echo(json.dumps({"driver": driver, "port": port, "seed": seed, "trials": list(map(asdict, findings))}))
    else:
        rows = [(one.trial, "kept" if one.kept else "BROKEN", one.figure) for one in findings]
        click.echo(columns([("trial", "promise", "figure"), *rows]))
    if not all(one.kept for one in findings):
        raise click.exceptions.Exit(FAILED)


def _at_port(driver: str, port: str, config: Path, folder: Path) -> AbstractContextManager[StageRig]:
    """A real stage, once somebody has agreed that it moves."""
    from station.bench.conform import at_port
    from station.bench.opening import read_config

    tables = read_config(config).values() if config.exists() else []
    table: dict[str, Any] = next((dict(one) for one in tables if one["driver"] == driver), {"driver": driver})
    click.confirm(f"The stage at {port} will move along its whole travel. Is the way free?", abort=True, err=True)
    return at_port({**table, "port": port}, folder)
