"""`station serve` and `station simulate`: the bench, or the simulated one, for other programs."""

from __future__ import annotations

import json
import os
import socket
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.terminal.bench_options import (
    config_option,
    make_lab,
    seed_option,
    shaker_option,
    simulate_option,
    speed_option,
)
from station.cli.terminal.command import PATH, SEED, UNITS, FiniteNumber, command
from station.cli.terminal.inherited import inherited
from station.common.errors import log

if TYPE_CHECKING:
    from station.guide.workspace import StationLab
    from station.service.bench_state import ServedBench
    from station.service.hosting import Hosting

PORT = 11111
TOKEN = "STATION_TOKEN"
PATIENCE_S = 3.0


@command("serve")
@config_option
@inherited("--sessions", type=PATH, default=Path("sessions"), show_default=True)
@simulate_option
@shaker_option
@speed_option
@seed_option
@inherited("--specification", type=PATH, help="Limits for the results of new sessions, in TOML.")
@inherited("--unit", type=UNITS, help="Of frequencies in new sessions.  [default: from station.toml]")
@click.option("--host", default="127.0.0.1", show_default=True, help="Where to listen; 0.0.0.0 for the local network.")
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, show_default=True, help="0 selects a free one.")
@click.option("--token", help=f"Required from clients.  [default: {TOKEN} of the environment, or a new one]")
@click.option("--no-token", is_flag=True, help="Accept every client that reaches the port.")
@click.option("--discovery", is_flag=True, help="Answer Alpaca's discovery (UDP 32227).")
@click.option("--for-s", type=FiniteNumber(min=0, max=1e9), help="End after so many seconds.  [default: on Ctrl-C]")
@click.option("--json", "as_json", is_flag=True, help="Write address and token as one JSON object.")
def serve(
    host: str, port: int, token: str | None, no_token: bool, discovery: bool, for_s: float | None, as_json: bool,
    **options: Any,
) -> None:  # fmt: skip
    """Serve bench, sessions and runs to other programs until Ctrl-C: JSON over HTTP, Alpaca, a page for a phone.

    Stopping the bench requires no token.
    """
    from procedures.outcome import BadParameter
    from station.common.stop_signals import closed_whole, guarded

    lab = make_lab(**options)
    if token is not None and no_token:
        raise BadParameter("--token and --no-token contradict each other", "omit one of them")
    try:
        from station.service.access import check_token, new_token
        from station.service.hosting import listen
    except ImportError as error:
        reason = f"the extra `serve` is needed, and {error.name} is not installed"
        raise BadParameter(reason, "install it: pip install 'calibration-station[serve]'") from error
    given = token if token is not None else os.environ.get(TOKEN)
    key = None if no_token else new_token() if given is None else check_token(given)
    ended = threading.Event()
    with listen(host, port) as listening, ExitStack() as besides:
        if discovery:
            from station.service.alpaca.discovery import Discovery

            besides.callback(Discovery(listening.getsockname()[1]).close)
        with closed_whole(lab.close), guarded(lab.stop_run, ended.set, terminated=0):
            served, hosting = _begin(lab, listening, host, key)
            try:
                _announce(host, hosting.port, key, as_json, served)
                ended.wait(for_s)
            finally:
                hosting.end()
                served.close(PATIENCE_S)
    log("ended", "the server has ended, and all devices have stopped")


def _begin(lab: StationLab, listening: socket.socket, host: str, token: str | None) -> tuple[ServedBench, Hosting]:
    """Open the bench and start to serve. Raises DeviceError for an invalid bench."""
    from station.service.bench_state import ServedBench
    from station.service.hosting import Hosting
    from station.service.site import site

    closing = threading.Event()
    served = ServedBench(lab)
    hosting = Hosting(site(served, host=host, token=token, closing=closing), listening, closing)
    hosting.begin()
    return served, hosting


def _announce(host: str, port: int, token: str | None, as_json: bool, served: ServedBench) -> None:
    from station.service.access import is_loopback

    address = f"http://{_reached_at(host)}:{port}"
    page = f"{address}/?token={token}" if token else f"{address}/"
    access = {"address": address, "token": token, "page": page}
    click.echo(json.dumps(access) if as_json else f"{address}\ntoken   {token or 'none'}\npage    {page}")
    for row in served.rows:
        if row.error is not None:
            log("device", f"{row.name}: {row.error.reason}", level="error", remedy=row.error.remedy)
    if served.bench is None:
        log("no_bench", "there is no station.toml: only sessions are served, and runs by hand", level="warning")
    if token is None and not is_loopback(host):
        words = f"any client that reaches {address} can move the bench"
        log("open", words, level="warning", remedy="omit --no-token")


def _reached_at(host: str) -> str:
    """The address for clients: for a server on all interfaces, that of this machine in its network."""
    if host not in ("0.0.0.0", "::"):
        return f"[{host}]" if ":" in host else host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address reserved for documentation: nothing is sent
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])


@command("simulate", log_json=False)
@inherited("--seed", type=SEED, default=0, show_default=True, help="Of all noise, and of the faults.")
@click.option("--faults", is_flag=True, help="Lose, change and duplicate bytes at random, and stop answering.")
@click.option("--folder", type=PATH, default=Path("incoming"), show_default=True, help="Where RAW files go.")
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
