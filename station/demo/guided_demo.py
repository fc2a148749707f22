"""The guided demonstration: a calibration on the simulated bench by a scripted operator."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from station.common.stop_signals import guarded
from station.guide.frontend import Event, FrameEvent, ProblemEvent, ProgressEvent, Result, RunEnded, StepBegan
from station.guide.scripted import ScriptedOperator
from station.guide.workspace import StationLab

PLAN = "pattern"
Report = Callable[[str, str], None]
"""Receives a sentence and, for a problem, its remedy."""


@dataclass
class EventReporter:
    """Reports the events of a run, repeated ones once per step; keeps the result."""

    report: Report
    result: Result | None = None
    _reported: set[str] = field(default_factory=set)

    def notify(self, event: Event) -> None:
        match event:
            case StepBegan(step):
                self._reported.clear()
                self.report(f"{step.title}: {step.instruction}", "")
            case ProgressEvent(sentence):
                self._once(sentence)
            case FrameEvent(_, advice) if advice.say:
                self._once(advice.say)
            case ProblemEvent(reason, remedy):
                self.report(reason, remedy)
            case Result():
                self.result = event
                self.report(f"{event.verdict}: {event.folder}", event.remedy)

    def _once(self, sentence: str) -> None:
        if sentence not in self._reported:
            self._reported.add(sentence)
            self.report(f"  {sentence}", "")


def run_guided(out: Path, seed: int, report: Report, plan: str = PLAN) -> tuple[RunEnded, Result | None]:
    """Run a plan in a new session in `out`, in virtual time; Ctrl-C stops the bench and ends the run."""
    lab = StationLab(sessions=out, config=None, simulate=True, seed=seed)
    lab.virtual_time = True
    reporter = EventReporter(report)
    try:
        with guarded(lab.stop_run, lab.ask_run_to_stop):
            return lab.begin(plan, *lab.names, ScriptedOperator(listen=reporter.notify)).go(), reporter.result
    finally:
        lab.close()
