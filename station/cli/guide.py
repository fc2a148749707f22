"""`station --plain`: a guided procedure as lines on stdin and stdout."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from procedures.outcome import BadParameter
from procedures.plan import Ask
from station.cli.app import usual_config
from station.cli.errors import INTERRUPTED, REFUSED
from station.lab import StationLab
from station.operator import Event, Result, RunEnded, Stopped
from station.plain import Plain
from station.signals import EXIT_DEVICE, guarded

if TYPE_CHECKING:
    from station.lab import Running


def run_plain(*, simulate: bool, config: Path | None, sessions: Path, seed: int, plan: str | None) -> None:
    """Guide the operator through a plan in a new session; exits with the contract's codes."""
    from station.plans import DEFAULT

    lab = StationLab(sessions=sessions, config=config or usual_config(), simulate=simulate, seed=seed)
    lab.virtual_time = True  # a simulated bench's time may jump: nobody watches it move
    operator = Watched(sys.stdin, sys.stdout)
    try:
        code = conduct(_begin(lab, plan or DEFAULT, operator), operator)
    except Stopped:
        code = INTERRUPTED
    finally:
        lab.close()
    raise click.exceptions.Exit(code)


def conduct(run: Running, operator: Watched) -> int:
    """Carry a run out, with Ctrl-C and SIGTERM as its stops; what the program is to return."""
    with guarded(run.stop_now, lambda: _ask_to_stop(operator, run)):
        return exit_code(run.go(), operator.result)


def _begin(lab: StationLab, plan: str, operator: Plain) -> Running:
    """A new session, named after camera and lens. Raises Stopped."""
    if plan not in lab.plans():
        raise BadParameter(f"there is no plan {plan!r}", f"choose one of {', '.join(lab.plans())}")
    camera, lens = (
        str(operator.answer(Ask(key, f"Which {key} is it?", "text", default=name)))
        for key, name in zip(("camera", "lens"), lab.names, strict=True)
    )
    return lab.begin(plan, camera, lens, operator)


def _ask_to_stop(operator: Plain, run: Running) -> None:
    """The first Ctrl-C: at a question it ends the run, else after this exposure."""
    run.ask_to_stop()
    if operator.asking:
        raise Stopped


class Watched(Plain):
    """A plain operator that remembers the result."""

    result: Result | None = None

    def hear(self, event: Event) -> None:
        """Write it down, and keep the result."""
        if isinstance(event, Result):
            self.result = event
        super().hear(event)


def exit_code(ended: RunEnded, result: Result | None) -> int:
    """What the program returns: 0 finished, 5 refused by the quality gate, 130 stopped, 3 emergency stop."""
    if ended.how == "emergency":
        return EXIT_DEVICE
    if ended.how == "stopped":
        return INTERRUPTED
    return REFUSED if result is not None and result.verdict == "refused" else 0
