"""`station conform`: whether a stage's driver keeps its promises, at its twin or at a real port."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.errors import BadConfiguration, DeviceError
from procedures.outcome import BadInput
from station.cli.bench.devices import FAILED, interrupt
from station.cli.terminal.bench_options import CONFIG, config_option
from station.cli.terminal.command import SEED, columns, command
from station.cli.terminal.inherited import inherited

if TYPE_CHECKING:
    from station.bench.conform import TrialResult


@command("conform", as_json=True, log_json=False)
@click.argument("driver", required=False)
@click.option("--port", help="Try it at this port; the stage moves along its whole travel.  [default: its twin]")
@click.option("--device", help="Try the device of this name in station.toml instead of a DRIVER.")
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
def conform(
    driver: str | None, port: str | None, device: str | None, config: Path | None, operations: int, seed: int,
    out: Path | None, key: Path | None, verify: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Try the DRIVER of a stage: promises, stop latency, faults of the line, random operation.

    At its twin, time is simulated and the line fails on purpose. With --port or --device a real stage is moved, without
    faults; with --port, its other options are those of the table with this driver in station.toml.
    """
    if verify is not None:
        _verify(verify, key, as_json)
        return
    if (driver is None) == (device is None):
        raise click.UsageError("Give either a DRIVER or --device.")
    if key is not None and out is None:
        raise click.UsageError("--key signs a record: give --out as well.")
    config = config or CONFIG
    table, real = _table(driver, port, device, config), bool(port or device)
    findings, record = _tried(table, config.parent if real else None, operations, seed, quiet=as_json)
    if as_json:
        trials = [asdict(one) for one in findings]
        click.echo(json.dumps({"driver": table["driver"], "port": port, "seed": seed, "trials": trials}))
    else:
        rows = [(one.trial, "kept" if one.kept else "BROKEN", one.figure) for one in findings]
        click.echo(columns([("trial", "promise", "figure"), *rows]))
    if out is not None:
        from station.reports.conformance import write_conformance

        for path in write_conformance(out, record, key):
            click.echo(path, err=True)
    if not all(one.kept for one in findings):
        raise click.exceptions.Exit(FAILED)


def _table(driver: str | None, port: str | None, device: str | None, config: Path) -> dict[str, Any]:
    """The table of the stage: of its twin, only the driver; of a real one, its options, once it may move."""
    from station.bench.opening import read_config

    if port is None and device is None:
        return {"driver": driver}
    tables = read_config(config) if config.exists() or device is not None else {}
    if device is not None and device not in tables:
        raise BadConfiguration(f"{config} has no device {device}", f"name one of {', '.join(tables) or 'them'}")
    if device:
        table = tables[device]
    else:
        table = next((one for one in tables.values() if one["driver"] == driver), {"driver": driver})
    click.confirm(
        f"The stage {f'at {port}' if port else device} will move along its whole travel. Is the way free?",
        abort=True,
        err=True,
    )
    return {**table, **({"port": port} if port else {})}


def _tried(
    table: Mapping[str, Any], place: Path | None, operations: int, seed: int, *, quiet: bool
) -> tuple[list[TrialResult], dict[str, Any]]:
    """The results of all trials, and their record; `place` is the folder of a real stage's station.toml."""
    from station.bench.conform import at_port, at_twin
    from station.bench.conform import conform as findings_of
    from station.common.durable_files import temporary_folder
    from station.common.stop_signals import guarded
    from station.reports.conformance import conformance_record, source_of

    identity: dict[str, str] = {}
    with temporary_folder() as folder:
        where = at_twin(table["driver"], folder) if place is None else at_port(table, place)
        with where as rig, guarded(rig.stage.emergency_stop, interrupt):
            with suppress(DeviceError):  # the first trial shows why
                identity = asdict(rig.stage.connect())
            findings = []
            for finding in findings_of(rig, operations=operations, seed=seed):
                findings.append(finding)
                if not quiet:
                    click.echo(f"{finding.trial}: {'kept' if finding.kept else 'BROKEN'}", err=True)
            source, at = source_of(type(rig.stage).__module__), "its twin" if place is None else rig.stage.address
    record = conformance_record(
        table["driver"], at=at, identity=identity, source=source, seed=seed, operations=operations,
        trials=findings,
    )  # fmt: skip
    return findings, record


def _verify(folder: Path, key: Path | None, as_json: bool) -> None:
    """Show the checks of a record. Exits with 4 if one does not agree."""
    from station.common.signature import AGREES
    from station.reports.conformance import check_conformance

    checks = list(check_conformance(folder, key))
    if as_json:
        click.echo(json.dumps({"folder": str(folder), "checks": [asdict(one) for one in checks]}))
    else:
        click.echo(columns([(one.name, AGREES[one.agrees], one.words) for one in checks]))
    if any(one.agrees is False for one in checks):
        raise click.exceptions.Exit(BadInput.exit_code)
