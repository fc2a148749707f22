"""The guided demonstration: a calibration on the simulated bench by an operator who does what he is asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from station.common.stop_signals import guarded
from station.guide.frontend import Event, FrameEvent, ProblemEvent, ProgressEvent, Result, RunEnded, StepBegan
from station.guide.scripted import ScriptedOperator
from station.guide.workspace import StationLab

PLAN = "pattern"
Tell = Callable[[str, str], None]
"""Hears of a sentence, and of its remedy where it is a trouble."""


@dataclass
class Teller:
    """Says what happens in a run, what is done again and again in a step only once; keeps the result."""

    tell: Tell
    result: Result | None = None
    _said: set[str] = field(default_factory=set)

    def notify(self, event: Event) -> None:
        """Say it."""
        match event:
            case StepBegan(step):
                self._said.clear()
                self.tell(f"{step.title}: {step.instruction}", "")
            case ProgressEvent(say):
                self._once(say)
            case FrameEvent(_, advice) if advice.say:
                self._once(advice.say)
            case ProblemEvent(reason, remedy):
                self.tell(reason, remedy)
            case Result():
                self.result = event
                self.tell(f"{event.verdict}: {event.folder}", event.remedy)

    def _once(self, sentence: str) -> None:
        if sentence not in self._said:
            self._said.add(sentence)
            self.tell(f"  {sentence}", "")


def run_guided(out: Path, seed: int, tell: Tell) -> tuple[RunEnded, Result | None]:
    """Go through the pattern's plan in a new session in `out`; how it ended, and its result.

    The bench's time jumps where it is waited for. Ctrl-C stops the bench and ends the run.
    """
    lab = StationLab(sessions=out, config=None, simulate=True, seed=seed)
    lab.virtual_time = True
    teller = Teller(tell)
    try:
        with guarded(lab.stop_run, lab.ask_run_to_stop):
            return lab.begin(PLAN, *lab.names, ScriptedOperator(listen=teller.notify)).go(), teller.result
    finally:
        lab.close()
