"""`station` alone: the operator's application."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from procedures.outcome import BadParameter
from station.app.background import at_once
from station.cli.terminal.bench_options import make_lab
from station.common.stop_signals import EXIT_DEVICE, handled, woken

if TYPE_CHECKING:
    from station.app.app import StationApp
    from station.guide.workspace import StationLab

PATIENCE_S = 3.0
"""Timeout for the application to exit, and for a run to write its last line."""


def run_app(plan: str | None, **options: Any) -> None:
    """Run the application until the operator leaves it; exits with its code. `options` are those of `make_lab`.

    Raises BadParameter where there is no such plan, or no terminal.
    """
    if plan is not None:
        check_plan(plan)
    lab = make_lab(**options)
    if not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        raise BadParameter("the application needs a terminal", "start it in one, or use station --plain")
    from station.app.app import StationApp, share_the_lock
    from station.app.terminal_report import reported_graphics

    app = StationApp(lab, plan=plan, graphics=reported_graphics())
    share_the_lock()
    with ended_by_signals(app, lab):
        try:
            code = app.run()
        finally:
            if app.return_code != 0:
                lab.stop_run()  # something may still be moving
            app.finish(PATIENCE_S)
            lab.close()
    raise click.exceptions.Exit(code if code is not None else app.return_code or 0)


@contextmanager
def ended_by_signals(app: StationApp, lab: StationLab) -> Iterator[None]:
    """Context in which INT, TERM, QUIT, and HUP of a lost terminal or ssh line stop the bench and end the program.

    TSTP stops the bench; the terminal's driver suspends the program afterwards.
    """

    def end() -> None:
        app.terminate()
        time.sleep(PATIENCE_S)  # it exits by itself, unless it is blocked by an unresponsive terminal
        app.finish(PATIENCE_S)
        lab.close()
        os._exit(EXIT_DEVICE)

    def hear(number: int, frame: FrameType | None) -> None:
        at_once(end)

    with woken(lab.stop_run), handled(hear):
        yield


def check_plan(name: str) -> None:
    """Raises BadParameter where there is no such plan."""
    from station.guide.catalogue import entry_named

    entry_named(name)
