"""Events and questions of a running plan: the one interface of all front ends.

The terminal application, the line front end on stdin and stdout, and the scripted operators of tests each implement
`Frontend`. A run calls it from its own thread; `notify` passes the event to the front end's loop and returns at once.
Questions block the run, never the front end.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from procedures.outcome import Cause, Verdict
from procedures.plan import Advice, Ask, Diagram, Fact, Goal, Plan, Step
from procedures.raw import Plane

if TYPE_CHECKING:
    from station.results.plane_result import PlaneResult

MOVE, LAMP, BY_HAND = "move", "lamp", "by_hand"
"""Keys of the questions before a movement, before the lamp is lit, and for a manual change. The text of the first two
states what moves or lights."""
NOT_NOW = "not now"
"""Declines these."""


@dataclass(frozen=True)
class Consent:
    """How front ends ask for a consent: what to check first, and the words that start it."""

    check: str
    start: str


CONSENTS = {MOVE: Consent("Is the way clear?", "move"), LAMP: Consent("Do not look into it.", "light it")}
"""Questions that a person must answer before something happens at the bench, by key."""


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
    """A frame was checked: one of its planes for the preview, and the advice.

    hold_s : of a preview while a person corrects a pose: remaining time for which the pose must be held; None outside
        its tolerance, and for other frames
    """

    plane: Plane
    advice: Advice
    hold_s: float | None = None


@dataclass(frozen=True)
class GoalEvent:
    """Progress of the photographs."""

    goal: Goal


@dataclass(frozen=True)
class Matched:
    """The open question is answered by the photographs: the pose was held, or the file has arrived."""


@dataclass(frozen=True)
class ScanEvent:
    """A scan so far: settings of the axis and their scores (NaN where none could be computed), of a quantity."""

    axis: str
    places: tuple[float, ...]
    scores: tuple[float, ...]
    quantity: str = "sharpness"


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


Event = (RunBegan | StepBegan | StepEnded | ProgressEvent | FrameEvent | GoalEvent | Matched | ScanEvent
         | DiagramEvent | ProblemEvent | Result | RunEnded)  # fmt: skip


class Frontend(Protocol):
    """A front end."""

    def notify(self, event: Event) -> None:
        """Show the event. Returns at once; never raises."""

    def answer(self, ask: Ask) -> Fact:
        """The operator's answer, of the requested kind. Blocks; raises `Stopped` when the operator ends the run."""


@runtime_checkable
class WatchedFrontend(Frontend, Protocol):
    """A front end with a live picture, whose open question the photographs themselves may answer."""

    def settle(self, fact: Fact) -> bool:
        """Answer the open question; False where none is open. From any thread."""


class Stopped(Exception):
    """The operator has asked to stop."""
