"""`station devices` and `station conform`: the configured devices, and whether a stage's driver keeps its promises."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from drivers.errors import BadConfiguration, DeviceError
from procedures.outcome import BadInput
from station.cli.result_log import check_strict
from station.cli.terminal.bench_options import (
    CONFIG,
    check_shaker,
    config_option,
    seed_option,
    shaker_option,
    simulate_option,
)
from station.cli.terminal.command import PATH, SEED, columns, command
from station.cli.terminal.inherited import inherited
from station.common.errors import log

if TYPE_CHECKING:
    from drivers.interfaces import Stage
    from station.bench.conform import TrialResult
    from station.bench.opening import Bench, DeviceRow

FAILED = 3


@command("devices", as_json=True)
@config_option
@simulate_option
@shaker_option
@seed_option
@click.option("--faults", is_flag=True, help="Inject faults into the simulated bench.")
@click.option("--wire-log", type=PATH, help="Write every byte on the wires to this folder.")
@click.option(
    "--commission", is_flag=True,
    help="Commission the stages: read their controllers, move them with your consent, report necessary changes.",
)  # fmt: skip
@click.option("--tap", is_flag=True, help="Measure the delay of the IMU's cable by taps that the box's unit feels too.")
@click.option("--output", type=PATH, help="Write the commissioned stages' tables to this new file.")
def devices(
    config: Path | None, simulate: bool, shaker: bool, seed: int, faults: bool, wire_log: Path | None, as_json: bool,
    commission: bool, tap: bool, output: Path | None,
) -> None:  # fmt: skip
    """Show each device: driver, address, identity, state, and the remedy for problems."""
    from station.bench.opening import make_bench, read_config, simulated_bench, simulated_tables
    from station.common.durable_files import temporary_folder
    from station.common.stop_signals import guarded

    check_shaker(simulate=simulate, shaker=shaker)
    if output is not None and not commission:
        raise click.UsageError("--output is for the tables of --commission: give that as well.")
    if output is not None and (output.exists() or not output.parent.is_dir()):
        raise click.UsageError(
            f"--output must be a new file in an existing folder, as nothing is replaced; got {output}"
        )
    with temporary_folder() as folder:
        if wire_log is not None:
            wire_log.mkdir(parents=True, exist_ok=True)
        if simulate:
            bench = simulated_bench(folder, seed=seed, faults=faults, shaker=shaker)
            tables = simulated_tables(bench.simulated.address, folder, shaker=shaker)
        else:
            path = config or CONFIG
            tables = read_config(path)
            bench = make_bench(tables, folder=path.resolve().parent, wire_log=wire_log)
        try:
            with guarded(bench.emergency_stop, interrupt):
                rows = bench.rows()
                if commission:
                    _commission(bench, rows, tables, output)
                if tap:
                    _tap(bench)
        finally:
            bench.close()
    click.echo(json.dumps([entry(row) for row in rows], indent=1) if as_json else table(rows))
    wrong = [row for row in rows if row.error is not None]
    for row in rows:
        if (caveat := row.condition.caveat) is not None:
            log("caveat", f"{row.name}: {caveat.reason}", level="warning", remedy=caveat.remedy)
    for row in wrong:
        assert row.error is not None
        log("device", f"{row.name}: {row.error.reason}", level="error", remedy=row.error.remedy)
    if wrong:
        raise click.exceptions.Exit(FAILED)


class AtTheTerminal:
    """The operator at the stage, questioned on the terminal; remarks go to stderr."""

    def show(self, words: str) -> None:
        click.echo(words, err=True)

    def agrees(self, question: str) -> bool:
        """Yes or no; no by default."""
        return click.confirm(question, default=False, err=True)

    def measures(self, question: str) -> float | None:
        """A number above 0, asked until it is valid; None for an empty answer."""
        while text := click.prompt(question, default="", show_default=False, err=True).strip():
            try:
                value = float(text.replace(",", "."))
            except ValueError:
                value = 0.0
            if 0 < value < float("inf"):
                return value
            self.show(f"a length must be a number above 0, such as 299.5; got {text!r}")
        return None


def _commission(bench: Bench, rows: list[DeviceRow], tables: Mapping[str, Any], output: Path | None) -> None:
    from station.bench.commission import commission

    stages = [row.name for row in rows if row.error is None and hasattr(bench.devices[row.name], "move_to")]
    written = [
        commission(name, cast("Stage", bench.devices[name]), tables[name], AtTheTerminal(), bench.clock)
        for name in stages
    ]
    if output is not None and written:
        output.write_text("\n".join(written), encoding="utf-8")
        log("written", f"the tables of {', '.join(stages)} are in {output}")


def _tap(bench: Bench) -> None:
    """Measure the delays of the units' cables, and write what belongs into their tables."""
    from drivers.errors import DeviceError
    from station.bench.common_event import TAPS, latencies

    def ask(name: str, n: int) -> None:
        click.echo(f"{name}: tap the rig once, now ({n + 1} of {TAPS})", err=True)

    try:
        measured = latencies(bench, ask)
    except DeviceError as error:
        log("tap", error.reason, level="error", remedy=error.remedy)
        raise click.exceptions.Exit(FAILED) from error
    for name, one in measured.items():
        click.echo(f"[devices.{name}]\nlatency_s = {one.latency_s:.4f}\nlatency_within_s = {one.within_s:.4f}")


def interrupt() -> None:
    """End at once: nothing moves here."""
    raise KeyboardInterrupt


def entry(row: DeviceRow) -> dict[str, Any]:
    """A row for JSON."""
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
        "caveat": f"{caveat.reason}: {caveat.remedy}" if (caveat := row.condition.caveat) else None,
    }


def table(rows: list[DeviceRow]) -> str:
    """The rows as aligned columns, with remedies for devices that are not usable yet."""
    cells = [["device", "driver", "answers as", "firmware", "serial", "state", "what to do"]]
    for row in rows:
        values = entry(row)
        words = [str(values[key] or "-") for key in ("model", "firmware", "serial", "state", "remedy")]
        cells.append([row.name, row.driver, *(words if row.error is None else ["-", "-", "-", "absent", "see below"])])
    return columns(cells)


@command("conform", strict=True, as_json=True, log_json=False)
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
    out: Path | None, key: Path | None, verify: Path | None, strict: bool, as_json: bool,
) -> None:  # fmt: skip
    """Try the DRIVER of a stage: promises, stop latency, faults of the line, random operation.

    At its twin, time is simulated and the line fails on purpose. With --port or --device a real stage is moved, without
    faults; with --port, its other options are those of the table with this driver in station.toml. With --strict,
    --verify exits with 1 if something could not be compared.
    """
    if verify is not None:
        _verify_conformance(verify, key, strict=strict, as_json=as_json)
        return
    if (driver is None) == (device is None):
        raise click.UsageError("Give either a DRIVER or --device.")
    if key is not None and out is None:
        raise click.UsageError("--key signs a record: give --out as well.")
    config = config or CONFIG
    table, real = _stage_table(driver, port, device, config), bool(port or device)
    findings, record = _tried(table, config.parent if real else None, operations, seed, quiet=as_json)
    if as_json:
        trials = [asdict(finding) for finding in findings]
        click.echo(json.dumps({"driver": table["driver"], "port": port, "seed": seed, "trials": trials}))
    else:
        rows = [(finding.trial, "kept" if finding.kept else "BROKEN", finding.figure) for finding in findings]
        click.echo(columns([("trial", "promise", "figure"), *rows]))
    if out is not None:
        from station.reports.conformance import write_conformance

        for path in write_conformance(out, record, key):
            click.echo(path, err=True)
    if not all(finding.kept for finding in findings):
        raise click.exceptions.Exit(FAILED)


def _stage_table(driver: str | None, port: str | None, device: str | None, config: Path) -> dict[str, Any]:
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
        table["driver"], at=at, identity=identity, source=source, seed=seed, operations=operations, trials=findings
    )
    return findings, record


def _verify_conformance(folder: Path, key: Path | None, *, strict: bool, as_json: bool) -> None:
    """Show the checks of a record. Exits with 4 if one does not agree."""
    from station.common.signature import AGREES
    from station.reports.conformance import check_conformance

    checks = list(check_conformance(folder, key))
    if as_json:
        click.echo(json.dumps({"folder": str(folder), "checks": [asdict(check) for check in checks]}))
    else:
        click.echo(columns([(check.name, AGREES[check.agrees], check.words) for check in checks]))
    if any(check.agrees is False for check in checks):
        raise click.exceptions.Exit(BadInput.exit_code)
    check_strict(("pass" if check.agrees else "doubtful" for check in checks), strict=strict)
