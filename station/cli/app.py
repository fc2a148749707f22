"""`station` alone: the operator's application."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import click

from procedures.outcome import BadParameter
from station.app.background import at_once
from station.cli.terminal.bench_options import usual_config
from station.common.stop_signals import EXIT_DEVICE, handled, woken
from station.guide.workspace import StationLab

if TYPE_CHECKING:
    from station.app.app import StationApp

PATIENCE_S = 3.0
"""How long the application may take to leave, and a run to write its last line."""


def run_app(
    *,
    simulate: bool,
    config: Path | None,
    sessions: Path,
    seed: int,
    shaker: bool = False,
    plan: str | None = None,
    specification: Path | None = None,
    unit: str | None = None,
) -> None:
    """Run the application until the operator leaves it; exits with its code.

    Raises BadParameter where there is no such plan, or no terminal.
    """
    if plan is not None:
        check_plan(plan)
    if specification is not None:
        check_specification(specification)
    if not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        raise BadParameter("the application needs a terminal", "start it in one, or use station --plain")
    from station.app.app import StationApp, share_the_lock

    lab = StationLab(
        sessions=sessions, config=config or usual_config(), simulate=simulate, seed=seed, specification=specification,
        shaker=shaker, unit=frozen_unit(unit, config),
    )  # fmt: skip
    app = StationApp(lab, plan=plan)
    share_the_lock()
    with ended_by_signals(app, lab):
        try:
            code = app.run()
        finally:
            if app.return_code != 0:
                lab.stop_run()  # whatever ended it may have left something moving
            app.finish(PATIENCE_S)
            lab.close()
    raise click.exceptions.Exit(code if code is not None else app.return_code or 0)


@contextmanager
def ended_by_signals(app: StationApp, lab: StationLab) -> Iterator[None]:
    """Within, INT, TERM, QUIT, and HUP of a terminal or ssh line that is gone stop the bench and end the program.

    TSTP stops the bench; the terminal's driver suspends the program afterwards.
    """

    def end() -> None:
        app.terminate()
        time.sleep(PATIENCE_S)  # it leaves by itself, unless it waits for a terminal that takes nothing any more
        app.finish(PATIENCE_S)
        lab.close()
        os._exit(EXIT_DEVICE)

    def hear(number: int, frame: FrameType | None) -> None:
        at_once(end)

    with woken(lab.stop_run), handled(hear):
        yield


def check_specification(path: Path) -> None:
    """Raises BadParameter where it cannot be meant."""
    from station.results.specification_file import read_specification

    read_specification(path)


def frozen_unit(name: str | None, config: Path | None) -> str | None:
    """The unit of new sessions' frequencies that is asked for here or by station.toml; None for the usual one."""
    from station.results.preferred_unit import preferred_unit
    from station.results.units import Unit

    unit = Unit(name.lower()) if name else preferred_unit(config)
    return None if unit is Unit.CYCLES else str(unit)


def check_plan(name: str) -> None:
    """Raises BadParameter where no plan is called so."""
    from station.guide.catalogue import entry_named

    entry_named(name)
