"""`station` alone: the operator's application."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from procedures.outcome import BadParameter
from station.lab import StationLab

CONFIG = Path("station.toml")


def run_app(*, simulate: bool, config: Path | None, sessions: Path, seed: int) -> None:
    """Run the application until the operator leaves it; exits with its code. Raises BadParameter without a terminal."""
    if not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        raise BadParameter("the application needs a terminal", "start it in one, or see the commands: station --help")
    from station.app import StationApp, share_the_lock

    lab = StationLab(sessions=sessions, config=config or usual_config(), simulate=simulate, seed=seed)
    app = StationApp(lab)
    share_the_lock()
    try:
        code = app.run()
    finally:
        if app.return_code != 0:
            lab.emergency_stop()  # whatever ended it may have left something moving
        lab.close()
    raise click.exceptions.Exit(code if code is not None else app.return_code or 0)


def usual_config() -> Path | None:
    """station.toml, where there is one."""
    return CONFIG if CONFIG.is_file() else None
