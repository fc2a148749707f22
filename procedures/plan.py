"""Guided procedures as data: one plan for the terminal, batch runs and tests.

A plan is a list of steps, a step a list of requests to operator and bench. `station.guide.run` carries out the requests
in order and stores their results as facts, by name, for the following requests. Requests that depend on facts hold
functions of them; these are pure, so that a replayed session asks the same questions.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from math import dist, inf, nan
from typing import Any, Literal

from procedures.outcome import Outcome
from procedures.raw import RawFrame

Fact = str | float | bool
Facts = Mapping[str, Fact]
"""Known facts: answers of the operator, results of checks, state of the bench. They can be stored as JSON.

With a frame come the facts at its time: position and travel limits of every axis (`at_z_mm`, `low_z_mm`, `high_z_mm`,
...), and `distance_mm` where a rangefinder measured.
"""
Outcomes = Mapping[str, Outcome[Any]]
"""Outcomes by plane."""
Known = MutableMapping[Hashable, Outcome[Any]]
"""Cache of estimates, keyed by all that they depend on: the photograph's hash, plane, chart, settings. A run holds one,
so that no plane of a photograph is estimated twice.
"""


@dataclass(frozen=True)
class Reading:
    """A live number with its tolerance from `low` to `high`; None is no limit."""

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


Points = tuple[tuple[float, float], ...]
"""Points (x, y) in pixels of a plane."""


@dataclass(frozen=True)
class Outline:
    """A pose to match: the corners of the subject as `present`, () where it is not found, and as `wanted`, in the same
    order."""

    present: Points
    wanted: Points

    @property
    def arrow(self) -> tuple[float, float]:
        """Way (x, y) of the subject's centre to its wanted place, in pixels; none where it is not found."""
        n = len(self.present) or 1
        x, y = (sum(v[i] - u[i] for u, v in self._pairs) / n for i in (0, 1))
        return x, y

    @property
    def off_px(self) -> float:
        """Largest distance of a corner from its wanted place; infinite where the subject is not found."""
        return max((dist(u, v) for u, v in self._pairs), default=inf)

    @property
    def growth(self) -> float:
        """Wanted size over the present one; 1 where the subject is not found."""
        present, wanted = (sum(map(dist, one, (*one[1:], *one[:1]))) for one in (self.present, self.wanted))
        return wanted / present if present else 1.0

    @property
    def _pairs(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        return list(zip(self.present, self.wanted, strict=False))


@dataclass(frozen=True)
class Goal:
    """Progress of the photographs: standard uncertainty `now` and `after` the next one, NaN where it is not known
    before the estimate; `left` is the number of photographs to the goal."""

    left: int
    name: str = ""
    unit: str = ""
    now: float = nan
    after: float = nan

    @property
    def say(self) -> str:
        """The progress as a line."""
        left = f"{self.left} photograph{'s' * (self.left != 1)} to the goal"
        if self.now != self.now:
            return f"{left}."
        now = f"{self.name} ± {self.now:.2g}" if self.now < inf else f"{self.name} unknown"
        return f"{now} now, ± {self.after:.2g} {self.unit} after the next photograph; {left}."


@dataclass(frozen=True)
class Advice:
    """Result of the check of a frame.

    good : whether the step may continue
    say : one sentence: what to do next, or the finding where all is good
    readings : the live numbers behind it
    moves : relative moves by axis (`z_mm`, `pan_deg`, ...) that correct it; a bench with these axes moves by itself,
        otherwise the operator does what `say` says
    by_hand : manual changes requested by `say`, in numbers (`chart_yaw_deg`, `exposure_ev`, ...)
    facts : facts for later requests
    marks : points of the plane to show on the preview
    outline : the pose to match, in the preview
    goal : progress of the photographs
    contradictory : keys of answers one of which must be wrong, as `say` explains; no move corrects that
    """

    good: bool
    say: str
    readings: tuple[Reading, ...] = ()
    moves: Mapping[str, float] = field(default_factory=dict)
    by_hand: Mapping[str, float] = field(default_factory=dict)
    facts: Facts = field(default_factory=dict)
    marks: Points = ()
    outline: Outline | None = None
    goal: Goal | None = None
    contradictory: tuple[str, ...] = ()


@dataclass(frozen=True)
class Diagram:
    """A curve that explains a choice.

    label : quantities of the axes
    x, y : (n,) x increasing
    say : its meaning in one or two sentences
    rows : the curve as a table, headings first
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    say: str
    rows: tuple[tuple[str, ...], ...] = ()


# --- requests ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ask:
    """A question to the operator; the answer becomes the fact `key`. Asked only if `when(facts)`.

    `kind` "confirm" is answered by True when done, "number" by a float within [low, high] in `unit`, "text" by a line,
    "choice" by one of `choices`. The default is the known fact `key`, else `proposed(facts)`, else `default`. Not asked
    where `given(facts)`, of facts including the equipment (`HAS_SHAKER`, `HAS_IMU`), gives the answer. `check(answer,
    facts)` raises ProcedureError for an invalid answer; the question is then repeated. `names_file` is true of those
    parts of an answer, separated by ";", that are names of files: the session stores copies, which replace them.
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
"""The fact that the bench has a shaker, which moves the camera around a path."""
HAS_IMU = "has_imu"
"""The fact that the bench has an IMU."""


@dataclass(frozen=True)
class Shake:
    """A closed path with the period `round_s`: by axis, fractions of the shaker's strokes at equal intervals."""

    round_s: float
    shares: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Give:
    """A file for the operator, such as the chart to print; `say(path)` is the instruction."""

    name: str
    make: Callable[[Facts], bytes]
    say: Callable[[str], str]


@dataclass(frozen=True)
class Show:
    """Show a curve before a choice that depends on it; None shows nothing."""

    diagram: Callable[[Facts], Diagram | None]


@dataclass(frozen=True)
class Home:
    """Home every stage of the bench, if any."""


@dataclass(frozen=True)
class Go:
    """Move to the positions `to(facts)`, by axis. Where the bench cannot, the operator does what `say` says; "" is
    nothing to do. `by_hand` gives the manual changes requested by `say`, in numbers.
    """

    to: Callable[[Facts], Mapping[str, float]]
    say: Callable[[Facts], str]
    by_hand: Callable[[Facts], Mapping[str, float]] = lambda facts: {}


@dataclass(frozen=True)
class SetLight:
    """Set the lamp, if any, to a level in [0, 1]."""

    level: Callable[[Facts], float]


@dataclass(frozen=True)
class Measure:
    """Read the rangefinder, if any; the reading becomes the fact `distance_mm`."""


@dataclass(frozen=True)
class Look:
    """Expose a trial frame of the settled rig, check it, correct as advised, and repeat until it is good.

    `check(frame, facts)` is pure. After `tries` looks the operator decides: look again, go on unchanged, or stop.
    `rests_on` are the keys of the answers from which its moves are computed. Skipped unless `when(facts)`.
    """

    purpose: str
    check: Callable[[RawFrame, Facts], Advice]
    tries: int = 8
    rests_on: tuple[str, ...] = ()
    when: Callable[[Facts], bool] = lambda facts: True


@dataclass(frozen=True)
class Scan:
    """Expose a trial frame at each of several settings of one axis, then go to the best.

    `places(facts)` are the settings; `score(frame, facts)` is one number per frame, of the `quantity`, larger is
    better, NaN where it is unknown; `choose(places, scores)` gives the best. Where the bench lacks the axis, the
    operator sets it.
    """

    purpose: str
    axis: str
    places: Callable[[Facts], Sequence[float]]
    score: Callable[[RawFrame, Facts], float]
    choose: Callable[[Sequence[float], Sequence[float]], Advice]
    say: Callable[[float], str]
    quantity: str = "sharpness"


@dataclass(frozen=True)
class Shoot:
    """Take shots until `enough`. A shot that `check` refuses is stored, but does not count.

    `estimate(frame, facts, results, known)` estimates from a shot, given the results of the earlier ones.
    `enough(results, facts)` decides from the estimates so far whether to continue. `record_motion` records the IMU
    during each exposure, without waiting for the rig to settle. `shake` is the path of the shaker meanwhile, if any.
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
    """One place of a tour: its name, which is the purpose of its shots, the move to it, and the check of a shot."""

    name: str
    go: Go
    check: Callable[[RawFrame, Facts], Advice]


@dataclass(frozen=True)
class Tour:
    """One shot that counts at each of several places. Places that have one are not visited again.

    `stops` depends on facts known before the tour, so that a resumed tour has the same places. After `tries` shots that
    do not count the operator decides: skip the place, try again, or stop.
    """

    stops: Callable[[Facts], Sequence[TourStop]]
    tries: int = 4


@dataclass(frozen=True)
class Estimate:
    """Compute the result from all shots that count, by plane; `known` caches the estimates so far, `facts_from` gives
    facts for later requests."""

    estimate: Callable[[Sequence[RawFrame], Facts, Known], Outcomes]
    facts_from: Callable[[Mapping[str, Any]], Facts] = lambda estimates: {}


@dataclass(frozen=True)
class Decide:
    """Ask the operator to accept the result or to retake from the step `retake`, the default if `again(facts)`."""

    retake: str
    again: Callable[[Facts], bool] = lambda facts: False


Request = Ask | Give | Show | Home | Go | SetLight | Measure | Look | Scan | Shoot | Tour | Estimate | Decide


@dataclass(frozen=True)
class Step:
    """One step of a plan: title, instruction in a sentence or two, and requests.

    `drawing` illustrates the step in lines of ASCII (`procedures.drawings`) until it has a photograph; `gave(facts)` is
    its value in at most twelve characters ("s/t 1.28"), or "". The step is skipped unless `when(facts)`.
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
    """A guided procedure. `name` identifies it in sessions and procedure files.

    `subject` is the subject of its photographs, for simulated benches: "chart", "frame" (the chart, small in the
    frame), "tilt" (the same with a tilted sensor), "wall", "depth", "panel" or "edge". `facts` is the dataclass of
    its facts (`procedures.facts`), if any.
    """

    name: str
    title: str
    steps: tuple[Step, ...]
    subject: str = "chart"
    facts: type[Any] | None = None

    def asks(self) -> dict[str, Ask]:
        """All questions by key."""
        requests = (request for step in self.steps for request in step.requests)
        return {request.key: request for request in requests if isinstance(request, Ask)}

    def step(self, name: str) -> Step:
        """The step by name. Raises KeyError."""
        for step in self.steps:
            if step.name == name:
                return step
        raise KeyError(name)
