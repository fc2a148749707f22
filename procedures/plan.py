"""What a guided procedure asks of operator and bench, as data: one plan for the terminal, for batch runs and tests.

A plan is a list of steps, a step a list of requests. Whoever runs a plan (`station.guide.run`) carries the requests
out in order and keeps what they teach as facts, by name, for the requests that follow. Requests that depend on facts
hold functions of them; those functions are pure, so that replaying a session asks the same things again.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from procedures.outcome import Outcome
from procedures.raw import RawFrame

Fact = str | float | bool
Facts = Mapping[str, Fact]
"""What is known so far: answers of the operator, what checks learned, what the bench said. JSON can hold it.

With a frame come facts of its moment: for every axis where it is and the ends of its travel, `at_z_mm`, `low_z_mm`,
`high_z_mm` and so on; `distance_mm` where a rangefinder measured.
"""
Outcomes = Mapping[str, Outcome[Any]]
"""What was found, by plane."""
Known = MutableMapping[Hashable, Outcome[Any]]
"""What was estimated already, by all that it depends on: the photograph's hash, plane, chart, settings. A run holds one
from its first shot to its report, so that no plane of a photograph is estimated twice.
"""


@dataclass(frozen=True)
class Reading:
    """A live number with what it should be: `low` and `high` are the tolerance, None where there is no limit."""

    name: str
    value: float
    unit: str
    low: float | None = None
    high: float | None = None

    @property
    def good(self) -> bool:
        """Whether it lies within its tolerance; NaN does not."""
        above = self.low is None or self.value >= self.low
        below = self.high is None or self.value <= self.high
        return above and below and self.value == self.value


@dataclass(frozen=True)
class Advice:
    """What a look at a frame says.

    Attributes
    ----------
    good : whether the step may go on
    say : one sentence: what to do next, or what was found where all is good
    readings : the live numbers behind it
    moves : by axis (`z_mm`, `pan_deg`, ...), how far to move from here so that it becomes good; a bench that has
        these axes moves by itself, otherwise the operator does what `say` says
    by_hand : what `say` asks of the operator's hands, in numbers (`chart_yaw_deg`, `exposure_ev`, ...)
    facts : what later requests shall know
    marks : (n, 2) points (x, y) of the plane to show on the preview
    doubted : keys of what was asked, one of which cannot be right: `say` tells what contradicts what, no move mends it
    """

    good: bool
    say: str
    readings: tuple[Reading, ...] = ()
    moves: Mapping[str, float] = field(default_factory=dict)
    by_hand: Mapping[str, float] = field(default_factory=dict)
    facts: Facts = field(default_factory=dict)
    marks: tuple[tuple[float, float], ...] = ()
    doubted: tuple[str, ...] = ()


@dataclass(frozen=True)
class Diagram:
    """A curve that explains a choice.

    Attributes
    ----------
    label : what is drawn over what
    x, y : (n,) x rising
    say : one or two sentences: what it means
    rows : the same as a table, its headings first
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    say: str
    rows: tuple[tuple[str, ...], ...] = ()


# --- requests ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ask:
    """A question to the operator; the answer becomes the fact `key`. Not asked where `when`, of what is known, says no.

    `kind` "confirm" is answered by True when it is done, "number" by a float within [low, high] in `unit`, "text" by
    a line, "choice" by one of `choices`. The default is what is known under `key` already, else what `proposed` derives
    from what is known, else `default`. Not asked
    either where `given`, of what is known and what the bench has (`HAS_SHAKER`, `HAS_IMU`), tells the answer. `check`,
    of an answer and what is known, raises ProcedureError where it cannot be taken: it is said, and asked again.
    `names_file` tells which parts of an answer, with ; between them, are names of files: whoever runs the plan keeps
    copies, and these are the answer.
    """

    key: str
    question: str
    kind: Literal["confirm", "number", "text", "choice"] = "confirm"
    unit: str = ""
    default: Fact | None = None
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    when: Callable[[Facts], bool] = lambda facts: True
    given: Callable[[Facts], Fact | None] = lambda facts: None
    proposed: Callable[[Facts], Fact | None] = lambda facts: None
    check: Callable[[Fact, Facts], object] = lambda answer, facts: None
    names_file: Callable[[str], bool] = lambda part: False


HAS_SHAKER = "has_shaker"
"""The fact that the bench has something that carries the camera around a path."""
HAS_IMU = "has_imu"
"""The fact that the bench has an IMU."""


@dataclass(frozen=True)
class Shake:
    """A closed path, once around in `round_s`: by axis, shares of the shaker's strokes at equal times."""

    round_s: float
    shares: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Give:
    """A file for the operator, such as the chart to print; `say` tells what to do with it, given its path."""

    name: str
    make: Callable[[Facts], bytes]
    say: Callable[[str], str]


@dataclass(frozen=True)
class Show:
    """Show a curve that the facts tell, before something is chosen by it; None is nothing to show."""

    diagram: Callable[[Facts], Diagram | None]


@dataclass(frozen=True)
class Home:
    """Let every stage of the bench find its reference; nothing where the bench has none."""


@dataclass(frozen=True)
class Go:
    """Move to the places that the facts tell, by axis. Where the bench cannot, the operator does what `say` says; "" is
    nothing to do. `by_hand` is what `say` asks of the operator's hands, in numbers.
    """

    to: Callable[[Facts], Mapping[str, float]]
    say: Callable[[Facts], str]
    by_hand: Callable[[Facts], Mapping[str, float]] = lambda facts: {}


@dataclass(frozen=True)
class SetLight:
    """Set the lamp to a level in [0, 1]; nothing where the bench has none."""

    level: Callable[[Facts], float]


@dataclass(frozen=True)
class Measure:
    """Ask the rangefinder; the facts become `distance_mm`, its reading. Nothing where the bench has none."""


@dataclass(frozen=True)
class Look:
    """Expose a trial frame when the rig is still, check it, mend what the check says, and look again until it is good.

    `check(frame, facts)` is pure. After `tries` looks the operator decides: look again, go on with what is, or stop.
    `rests_on` are the keys of what was asked and its moves are reckoned from. Left out where `when` says no.
    """

    purpose: str
    check: Callable[[RawFrame, Facts], Advice]
    tries: int = 8
    rests_on: tuple[str, ...] = ()
    when: Callable[[Facts], bool] = lambda facts: True


@dataclass(frozen=True)
class Scan:
    """Expose a trial frame at each of several settings of one axis, then go to the best of them.

    `places(facts)` are the settings; `score(frame, facts)` is one number per frame, larger is better, NaN where it
    cannot be told; `choose(places, scores)` says where to go. Where the bench has not the axis, the operator sets it.
    """

    purpose: str
    axis: str
    places: Callable[[Facts], Sequence[float]]
    score: Callable[[RawFrame, Facts], float]
    choose: Callable[[Sequence[float], Sequence[float]], Advice]
    say: Callable[[float], str]


@dataclass(frozen=True)
class Shoot:
    """Take shots that count until they are enough. A shot that `check` refuses is kept, but does not count.

    `estimate(frame, facts, results, known)` is what a shot gives, beside the results of the shots before it.
    `enough(results, facts)`: from the outcomes of `estimate` of the shots so far, whether to go on. `record_motion`:
    the IMU is recorded during each exposure, which is not waited for until the rig is still. `shake` is what a shaker
    does meanwhile, where the bench has one.
    """

    purpose: str
    check: Callable[[RawFrame, Facts], Advice]
    estimate: Callable[[RawFrame, Facts, Sequence[Outcomes], Known], Outcomes]
    enough: Callable[[Sequence[Outcomes], Facts], Advice]
    most: int = 16
    record_motion: bool = False
    shake: Callable[[Facts], Shake | None] = lambda facts: None


@dataclass(frozen=True)
class TourStop:
    """One place of a tour: its name, which its shots bear as their purpose; how to get there; whether a shot counts.

    What `check` advises against a shot is followed before the next try.
    """

    name: str
    go: Go
    check: Callable[[RawFrame, Facts], Advice]


@dataclass(frozen=True)
class Tour:
    """One shot that counts at each of several places. A place that has one already is not visited again.

    `stops` is a function of what was known before the tour, so that an interrupted one goes on with the same places.
    After `tries` shots that do not count the operator decides: leave the place out, try again, or stop.
    """

    stops: Callable[[Facts], Sequence[TourStop]]
    tries: int = 4


@dataclass(frozen=True)
class Estimate:
    """Draw the result from all shots that count, by plane, and judge it; `known` is what their judging gave.

    `tells` is what later requests shall know, of what was found by plane.
    """

    estimate: Callable[[Sequence[RawFrame], Facts, Known], Outcomes]
    tells: Callable[[Mapping[str, Any]], Facts] = lambda found: {}


@dataclass(frozen=True)
class Decide:
    """Show the verdict and ask the operator: accept, or retake, which goes back to the step named.

    `again` tells, of what is known, whether to retake is what is usually meant.
    """

    retake: str
    again: Callable[[Facts], bool] = lambda facts: False


Request = Ask | Give | Show | Home | Go | SetLight | Measure | Look | Scan | Shoot | Tour | Estimate | Decide


@dataclass(frozen=True)
class Step:
    """One entry of the guide's rail: a word for it, what it is about in a sentence or two, and its requests.

    `drawing` shows what to do, in lines of ASCII (`procedures.drawings`), until the step has a photograph; `gave` is
    what the step gave, in at most twelve characters ("s/t 1.28"), of what is known; "" where it gave no number. Nothing
    of it is asked or done where `when`, of what is known, says no.
    """

    name: str
    title: str
    instruction: str
    requests: tuple[Request, ...]
    drawing: str = ""
    gave: Callable[[Facts], str] = lambda facts: ""
    when: Callable[[Facts], bool] = lambda facts: True


@dataclass(frozen=True)
class Plan:
    """A guided procedure. `name` is what sessions and procedure files call it.

    `subject` is what it photographs: a simulated bench stands before that. "chart", "frame" (the chart, small in the
    frame), "tilt" (the same, by a tilted sensor), "wall", "depth" or "panel".
    `facts` is the dataclass of what it knows (`procedures.facts`), where it has one.
    """

    name: str
    title: str
    steps: tuple[Step, ...]
    subject: str = "chart"
    facts: type[Any] | None = None

    def asks(self) -> dict[str, Ask]:
        """All its questions, by their keys."""
        requests = (request for step in self.steps for request in step.requests)
        return {request.key: request for request in requests if isinstance(request, Ask)}

    def step(self, name: str) -> Step:
        """The step of that name. Raises KeyError."""
        for step in self.steps:
            if step.name == name:
                return step
        raise KeyError(name)
