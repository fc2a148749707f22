"""`station conform`: whether a stage's driver keeps its promises, at its twin or at a real port."""

from __future__ import annotations

import json
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.errors import DeviceError
from procedures.outcome import BadInput
from station.cli.bench.devices import FAILED, interrupt
from station.cli.terminal.bench_options import CONFIG, config_option
from station.cli.terminal.columns import columns
from station.cli.terminal.inherited import inherited
from station.cli.terminal.numbers import SEED

if TYPE_CHECKING:
    from station.bench.conform import StageRig, TrialResult

AGREES = {True: "agrees", False: "DIFFERS", None: "not compared"}


@click.command()
@click.argument("driver", required=False)
@click.option("--port", help="Try it at this port; the stage moves along its whole travel.  [default: its twin]")
@config_option
@click.option(
    "--operations", type=click.IntRange(5, 100_000), default=500, show_default=True, help="Length of the random soak."
)
@inherited("--seed", type=SEED, default=0, show_default=True, help="Of the random operations and faults.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), help="Write record and page into this folder.")
@click.option(
    "--key",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Sign the record with this Ed25519 key (PEM), which is created where there is none.",
)
@click.option(
    "--verify",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Check record, page, signature and driver of this folder instead.",
)
@click.option("--json", "as_json", is_flag=True, help="Write the findings as JSON to stdout.")
def conform(
    driver: str | None, port: str | None, config: Path | None, operations: int, seed: int, out: Path | None,
    key: Path | None, verify: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Try the DRIVER of a stage: promises, stop latency, faults of the line, random operation.

    At its twin, time is simulated and the line fails on purpose. With --port a real stage is moved, without faults; its
    other options are those of the table with this driver in station.toml.

    Example: station conform zaber --out conformance --key laboratory.pem
    """
    if verify is not None:
        _verify(verify, key, as_json)
        return
    if driver is None:
        raise click.UsageError("Missing argument 'DRIVER'.")
    if key is not None and out is None:
        raise click.UsageError("--key signs a record: give --out as well.")
    findings, record = _tried(driver, port, config, operations, seed, quiet=as_json)
    if as_json:
        click.echo(json.dumps({"driver": driver, "port": port, "seed": seed, "trials": list(map(asdict, findings))}))
    else:
        rows = [(one.trial, "kept" if one.kept else "BROKEN", one.figure) for one in findings]
        click.echo(columns([("trial", "promise", "figure"), *rows]))
    if out is not None:
        from station.reports.conformance import write_conformance

        for path in write_conformance(out, record, key):
            click.echo(path, err=True)
    if not all(one.kept for one in findings):
        raise click.exceptions.Exit(FAILED)


def _tried(
    driver: str, port: str | None, config: Path | None, operations: int, seed: int, *, quiet: bool
) -> tuple[list[TrialResult], dict[str, Any]]:
    """The results of all trials, and their record."""
    from station.bench.conform import at_twin
    from station.bench.conform import conform as findings_of
    from station.common.leftovers import temporary_folder
    from station.common.stop_signals import guarded
    from station.reports.conformance import conformance_record, source_of

    identity: dict[str, str] = {}
    with temporary_folder() as folder:
        place = at_twin(driver, folder) if port is None else _at_port(driver, port, config or CONFIG, folder)
        with place as rig, guarded(rig.stage.emergency_stop, interrupt):
            with suppress(DeviceError):  # the first trial shows why
                identity = asdict(rig.stage.connect())
            findings = []
            for finding in findings_of(rig, operations=operations, seed=seed):
                findings.append(finding)
                if not quiet:
                    click.echo(f"{finding.trial}: {'kept' if finding.kept else 'BROKEN'}", err=True)
            source = source_of(type(rig.stage).__module__)
    record = conformance_record(
        driver, at=port or "its twin", identity=identity, source=source, seed=seed, operations=operations,
        trials=findings,
    )  # fmt: skip
    return findings, record


def _verify(folder: Path, key: Path | None, as_json: bool) -> None:
    """Show the checks of a record. Exits with 4 if one does not agree."""
    from station.reports.conformance import check_conformance

    checks = list(check_conformance(folder, key))
    if as_json:
        click.echo(json.dumps({"folder": str(folder), "checks": [asdict(one) for one in checks]}))
    else:
        click.echo(columns([(one.name, AGREES[one.agrees], one.words) for one in checks]))
    if any(one.agrees is False for one in checks):
        raise click.exceptions.Exit(BadInput.exit_code)


def _at_port(driver: str, port: str, config: Path, folder: Path) -> AbstractContextManager[StageRig]:
    """A real stage, once somebody has agreed that it moves."""
    from station.bench.conform import at_port
    from station.bench.opening import read_config

    tables = read_config(config).values() if config.exists() else []
    table: dict[str, Any] = next((dict(one) for one in tables if one["driver"] == driver), {"driver": driver})
    click.confirm(f"The stage at {port} will move along its whole travel. Is the way free?", abort=True, err=True)
    return at_port({**table, "port": port}, folder)
