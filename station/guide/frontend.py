"""Events and questions of a running plan: the one interface of all front ends.

The terminal application, the line front end on stdin and stdout, and the scripted operators of tests each implement
`Frontend`. A run calls it from its own thread; `notify` passes the event to the front end's loop and returns at once.
Questions block the run, never the front end.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from procedures.outcome import Cause, Verdict
from procedures.plan import Advice, Ask, Diagram, Fact, Plan, Step
from procedures.raw import Plane

if TYPE_CHECKING:
    from station.results.plane_result import PlaneResult

MOVE = "move"
"""Key of the question before a movement. Its text states what moves; each front end adds how to start it."""


@dataclass(frozen=True)
class RunBegan:
    """A plan starts or resumes: the names of the completed steps, and the value that each gave."""

    plan: Plan
    session: Path
    done: tuple[str, ...] = ()
    gave: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class StepBegan:
    """This step is the current one."""

    step: Step


@dataclass(frozen=True)
class StepEnded:
    """This step is complete; `gave` is the value that it gave, in a few characters."""

    step: Step
    gave: str = ""


@dataclass(frozen=True)
class ProgressEvent:
    """The current activity, as a phrase ("homing the rail", "waiting until the rig is still", "exposing").

    `done` of `total` where the work has countable parts, and the remaining seconds where they are known. An event that
    `lasts` is a note that stays visible with the next question, such as the path of the file to print.
    """

    say: str
    done: int = 0
    total: int = 0
    left_s: float | None = None
    lasts: bool = False


@dataclass(frozen=True, eq=False)
class FrameEvent:
    """A frame was checked: one of its planes for the preview, and the advice."""

    plane: Plane
    advice: Advice


@dataclass(frozen=True)
class ScanEvent:
    """A scan so far: settings of the axis and their scores (NaN where none could be computed)."""

    axis: str
    places: tuple[float, ...]
    scores: tuple[float, ...]


@dataclass(frozen=True)
class DiagramEvent:
    """A curve that explains the next question."""

    diagram: Diagram


@dataclass(frozen=True)
class ProblemEvent:
    """A problem and its remedy; the run continues."""

    reason: str
    remedy: str


@dataclass(frozen=True, eq=False)
class Result:
    """The result: its folder, its planes and the overall verdict."""

    folder: Path
    planes: Mapping[str, PlaneResult]
    verdict: Verdict
    reason: str
    remedy: str
    other_causes: tuple[Cause, ...] = ()


@dataclass(frozen=True)
class RunEnded:
    """The plan is complete ("finished"), or was ended by the operator ("stopped") or the emergency stop ("emergency").

    `certificate` : its page, where the session has a specification
    `empty` : nothing was answered or photographed; the session is not kept
    """

    how: str
    report: Path | None = None
    certificate: Path | None = None
    empty: bool = False


Event = (RunBegan | StepBegan | StepEnded | ProgressEvent | FrameEvent | ScanEvent | DiagramEvent | ProblemEvent
         | Result | RunEnded)  # fmt: skip


class Frontend(Protocol):
    """A front end."""

    def notify(self, event: Event) -> None:
        """Show the event. Returns at once; never raises."""
        ...

    def answer(self, ask: Ask) -> Fact:
        """The operator's answer, of the requested kind. Blocks; raises `Stopped` when the operator ends the run."""
        ...


class Stopped(Exception):
    """The operator has asked to stop."""
