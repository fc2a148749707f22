"""What a running plan tells whoever sits before it, and what it asks: the one interface of all front ends.

The terminal application, the plain guide on stdin and stdout, and the scripted operators of tests each are an
`Operator`. A run calls it from its own thread; a front end hands over to its own loop and returns at once from
`hear`. Questions block the run, never the front end.
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
"""The key of the question before something moves; what moves is its words, and each front end says how to begin."""


@dataclass(frozen=True)
class RunBegan:
    """A plan starts, or goes on where a session stopped: the names of the steps that are done already, and what they
    gave, by name.
    """

    plan: Plan
    session: Path
    done: tuple[str, ...] = ()
    gave: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class StepBegan:
    """The guide stands at this step now."""

    step: Step


@dataclass(frozen=True)
class StepEnded:
    """This step is done; `gave` is the number that it gave, in a few characters."""

    step: Step
    gave: str = ""


@dataclass(frozen=True)
class Doing:
    """What happens now, as a sentence ("homing the rail", "waiting until the rig is still", "exposing").

    `done` of `total` where the work has countable parts, and the seconds it will still take where that is known.
    What `lasts` is no work but a note, that holds beside the question that follows: where the file to print lies.
    """

    say: str
    done: int = 0
    total: int = 0
    left_s: float | None = None
    lasts: bool = False


@dataclass(frozen=True, eq=False)
class Seen:
    """A frame came and was checked: one plane of it for the preview, and what to do."""

    plane: Plane
    advice: Advice


@dataclass(frozen=True)
class CurveSeen:
    """A scan so far: settings of the axis, and their scores (NaN where none could be told)."""

    axis: str
    places: tuple[float, ...]
    scores: tuple[float, ...]


@dataclass(frozen=True)
class Shown:
    """A curve that explains what follows."""

    diagram: Diagram


@dataclass(frozen=True)
class Trouble:
    """Something went wrong and what to do about it; the run goes on as the sentence says."""

    reason: str
    remedy: str


@dataclass(frozen=True, eq=False)
class Result:
    """The estimate is there: where it lies, its planes, and the verdict on the whole."""

    folder: Path
    planes: Mapping[str, PlaneResult]
    verdict: Verdict
    reason: str
    remedy: str
    other_causes: tuple[Cause, ...] = ()


@dataclass(frozen=True)
class RunEnded:
    """The plan is through ("finished"), or ended by the operator ("stopped") or the emergency stop ("emergency").

    `certificate`: its page, where the session holds its lens to a specification. `empty`: nothing was answered or
    photographed, and the session is not kept.
    """

    how: str
    report: Path | None = None
    certificate: Path | None = None
    empty: bool = False


Event = RunBegan | StepBegan | StepEnded | Doing | Seen | CurveSeen | Shown | Trouble | Result | RunEnded


class Operator(Protocol):
    """A front end."""

    def hear(self, event: Event) -> None:
        """Show it. Returns at once; never raises."""
        ...

    def answer(self, ask: Ask) -> Fact:
        """The operator's answer, of the kind asked for. Blocks; raises `Stopped` when the operator ends the run."""
        ...


class Stopped(Exception):
    """The operator asked to stop: after this exposure, or now."""
