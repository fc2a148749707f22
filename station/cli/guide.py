"""`station --plain`: a guided procedure as lines on stdin and stdout."""

from __future__ import annotations

import gc
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from procedures.outcome import Verdict
from procedures.plan import Ask
from station.app.background import at_once
from station.cli.app import check_plan
from station.cli.terminal.bench_options import make_lab
from station.common.errors import INTERRUPTED, REFUSED
from station.common.stop_signals import EXIT_DEVICE, closed_whole, guarded
from station.guide.frontend import Event, Result, RunEnded, Stopped
from station.guide.line_frontend import LineOperator
from station.results.comparison import Compliance
from station.results.terms import specification_verdict

if TYPE_CHECKING:
    from station.guide.run import Run
    from station.guide.workspace import StationLab


def run_plain(plan: str | None, **options: Any) -> None:
    """Guide the operator through a plan in a new session. `options` are those of `make_lab`; exits with a code."""
    from station.guide.catalogue import DEFAULT

    lab = make_lab(**options)
    lab.virtual_time = True  # simulated time need not be real: nobody watches the bench
    operator = Watched(sys.stdin, sys.stdout)
    raise click.exceptions.Exit(conduct(lab, operator, lambda: _begin(lab, plan or DEFAULT, operator)))


def conduct(lab: StationLab, operator: Watched, begin: Callable[[], Run], *, strict: bool = False) -> int:
    """Begin a run and carry it out; signals and faults stop the bench. Gives the exit code."""
    stop = PlainStop(lab, operator)
    try:
        with closed_whole(lab.close), guarded(stop.now, stop.interrupted):
            running = begin()
            gc.freeze()  # also what was loaded for bench and plan: see `guarded`
            return exit_code(running.go(), operator.result, strict=strict)
    except Stopped:  # before there was a run
        return INTERRUPTED


class PlainStop:
    """Signals with a plain operator: all devices stop; at a question the run ends normally."""

    def __init__(self, lab: StationLab, operator: LineOperator) -> None:
        self._lab, self._operator = lab, operator
        self._at_question = False
        self._unreported = threading.Lock()
        """Taken by the first report: a signal and the exception that it raises stop the bench from two threads."""

    def now(self) -> None:
        """Stop the bench, and report it once; from any thread."""
        if self._operator.asking or self._at_question or not self._lab.has_run:  # no known movement
            self._lab.emergency_stop()
            return
        self._lab.stop_run()
        if self._unreported.acquire(blocking=False):
            at_once(self._operator.say_stopped)  # in a thread: an unread pipe must not block the next stop

    def interrupted(self) -> None:
        """After the first Ctrl-C, in the main thread. Raises Stopped at a question and before there is a run."""
        if self._operator.asking or not self._lab.has_run:
            self._at_question = True
            raise Stopped


def _begin(lab: StationLab, plan: str, operator: LineOperator) -> Run:
    """A new session of a camera and lens. Raises Stopped."""
    check_plan(plan)
    camera, lens = (
        str(operator.answer(Ask(key, f"Which {key} is it?", "text", default=name)))
        for key, name in zip(("camera", "lens"), lab.names, strict=True)
    )
    return lab.begin(plan, camera, lens, operator)


class Watched(LineOperator):
    """A plain operator that remembers the result."""

    result: Result | None = None

    def notify(self, event: Event) -> None:
        if isinstance(event, Result):
            self.result = event
        super().notify(event)


def exit_code(ended: RunEnded, result: Result | None, *, strict: bool = False) -> int:
    """The exit code.

    0 finished, 1 does not meet its specification, or is doubtful or undecided if `strict`, 5 refused by the quality
    gate, 130 stopped, 3 emergency stop.
    """
    if ended.how == "emergency":
        return EXIT_DEVICE
    if ended.how == "stopped":
        return INTERRUPTED
    if result is None:
        return 0
    if result.verdict == Verdict.REFUSED:
        return REFUSED
    compliance = specification_verdict(list(result.planes.values()))
    unsure = result.verdict != Verdict.PASS or compliance == Compliance.UNDECIDED
    return int(compliance == Compliance.MISSES or (strict and unsure))
