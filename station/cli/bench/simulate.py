"""`station simulate`: the simulated bench on pseudo-terminals and TCP, for other programs."""

import json
import threading
from pathlib import Path

import click

from station.cli.terminal.command import SEED, FiniteNumber, command
from station.cli.terminal.inherited import inherited


@command("simulate", log_json=False)
@inherited("--seed", type=SEED, default=0, show_default=True, help="Of all noise, and of the faults.")
@click.option("--faults", is_flag=True, help="Lose, change and duplicate bytes at random, and stop answering.")
@click.option(
    "--folder", type=click.Path(path_type=Path), default=Path("incoming"), show_default=True, help="Where RAW files go."
)
@click.option("--json", "as_json", is_flag=True, help="Write the addresses as one JSON object.")
@click.option("--for-s", type=FiniteNumber(min=0, max=1e9), help="End after so many seconds.  [default: on Ctrl-C]")
def simulate(seed: int, faults: bool, folder: Path, as_json: bool, for_s: float | None) -> None:
    """Open the simulated bench and print the address of each device, until Ctrl-C."""
    from station.bench.opening import simulated_bench
    from station.common.stop_signals import guarded

    folder.mkdir(parents=True, exist_ok=True)
    bench = simulated_bench(folder, seed=seed, faults=faults)
    ended = threading.Event()
    try:
        with guarded(bench.emergency_stop, ended.set, terminated=0):
            ports = bench.simulated.open_ports()
            addresses = {name: list(two) for name, two in ports.items()}
            click.echo(json.dumps(addresses) if as_json else listing(ports, folder))
            ended.wait(for_s)
    finally:
        bench.close()
    if ended.is_set():
        click.echo("the bench is closed", err=True)


def listing(ports: dict[str, tuple[str, str]], folder: Path) -> str:
    """The addresses as lines."""
    lines = [f"{name:12} {pty:14} {tcp}" for name, (pty, tcp) in ports.items()]
    return "\n".join([*lines, f"{'camera':12} RAW files appear in {folder} when the shutter is fired"])
