"""Guided procedures as data: one plan for the terminal, batch runs and tests.

A plan is a list of steps, a step a list of requests to operator and bench. `station.guide.run` carries out the requests
in order and stores their results as facts, by name, for the following requests. Requests that depend on facts hold
functions of them; these are pure, so that a replayed session asks the same questions.
"""

import math
from cmath import phase
from collections.abc import Callable, Collection, Hashable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field, fields
from math import degrees, dist, inf, nan
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_type_hints

from procedures.outcome import BadParameter, Outcome
from procedures.raw import RawFrame

Fact = str | float | bool
Facts = Mapping[str, Fact]
"""Known facts: answers of the operator, results of checks, state of the bench. They can be stored as JSON.

With a frame come the facts at its time: position and travel limits of every axis (`at_z_mm`, `low_z_mm`, `high_z_mm`,
...), and `distance_mm` where a rangefinder measured.
"""
Outcomes = Mapping[str, Outcome[Any]]  # outcomes by plane
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


Points = tuple[tuple[float, float], ...]  # points (x, y) in pixels of a plane


@dataclass(frozen=True)
class Outline:
    """A pose to match: the corners of the subject as `present`, () where it is not known, and as `wanted`, in the same
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
    def turn_deg(self) -> float:
        """Turn in the frame to the wanted pose, positive clockwise; 0 where the subject is not found."""
        pairs = [(complex(*u), complex(*v)) for u, v in self._pairs]
        a, b = (sum(one) / len(pairs) for one in zip(*pairs, strict=True)) if pairs else (0, 0)
        return degrees(phase(sum((v - b) * (u - a).conjugate() for u, v in pairs)))

    @property
    def _pairs(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        return list(zip(self.present, self.wanted, strict=False))


@dataclass(frozen=True)
class Goal:
    """Progress of the photographs: standard uncertainty `now` and `after` the next one, infinite where they do not
    determine it yet, NaN where it is not known before the estimate; `left` photographs to the goal."""

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
            return f"The uncertainty is known after the estimate; {left}."
        if self.after == inf:
            return f"{self.name}: more photographs are needed to state it; {left}."
        now = f"± {self.now:.2g} now" if self.now < inf else "unknown now"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name}: {now}, ± {self.after:.2g}{unit} after the next photograph; {left}."


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
    """A curve that explains a choice, or a drawing.

    label : quantities of the axes
    x, y : (n,) x increasing
    say : its meaning in one or two sentences
    rows : the curve as a table, headings first
    drawing : lines of ASCII in place of the curve
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    say: str
    rows: tuple[tuple[str, ...], ...] = ()
    drawing: str = ""


# --- requests ---


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


HAS_SHAKER = "has_shaker"  # the fact that the bench has a shaker, which moves the camera around a path
HAS_IMU = "has_imu"  # the fact that the bench has an IMU


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
    """One place of a tour: its name, which is the purpose of its shots, the move to it, the check of a shot, and the
    progress, by default the number of places left."""

    name: str
    go: Go
    check: Callable[[RawFrame, Facts], Advice]
    goal: Callable[[Facts], Goal | None] = lambda facts: None


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

    `drawing` illustrates the step in lines of ASCII (`procedures.drawings`) until it has a photograph; `gave` is a
    format of facts, or a function of them, for its value in at most twelve characters ("s/t {s_over_t:.2f}"). The step
    is skipped unless `when(facts)`.
    """

    name: str
    title: str
    instruction: str
    requests: tuple[Request, ...]
    drawing: str = ""
    gave: str | Callable[[Facts], str] = ""
    when: Callable[[Facts], bool] = lambda facts: True

    def value(self, facts: Facts) -> str:
        """Its value in a few characters; "" while facts are missing."""
        if callable(self.gave):
            return self.gave(facts)
        try:
            return self.gave.format_map(facts)
        except KeyError:
            return ""


@dataclass(frozen=True)
class Plan:
    """A guided procedure. `name` identifies it in sessions and procedure files.

    `subject` is the subject of its photographs, for simulated benches: "chart", "frame" (the chart, small in the
    frame), "tilt" (the same with a tilted sensor), "wall", "depth", "panel" or "edge". `facts` is the dataclass of
    its facts (`procedures.plan`), if any.
    """

    name: str
    title: str
    steps: tuple[Step, ...]
    subject: str = "chart"
    facts: type[Any] | None = None

    def asks(self) -> dict[str, Ask]:
        requests = (request for step in self.steps for request in step.requests)
        return {request.key: request for request in requests if isinstance(request, Ask)}

    def step(self, name: str) -> Step:
        """The step by name. Raises KeyError."""
        for step in self.steps:
            if step.name == name:
                return step
        raise KeyError(name)


# --- Typed facts of a plan: the facts in the journal, by name, become one frozen dataclass per plan ---
# A session stores facts by name as JSON. A plan reads them into its dataclass, with one field per name, None where it
# is unknown. Each field declares the inputs from which the fact is derived; the fact is dropped when one of them
# changes.

K = TypeVar("K")
T = TypeVar("T")
AT, LOW, HIGH = "at_", "low_", "high_"
INSISTED = "insisted_"  # prefix of a name: the operator confirmed that answer despite a contradiction
INPUTS, GATHERED = "inputs", "gathered"


@dataclass(frozen=True)
class AxisTravel:
    """Position and travel limits of an axis in the unit of its name; None where unknown."""

    at: float | None = None
    low: float | None = None
    high: float | None = None

    def nearest(self, place: float) -> float:
        """The nearest position within the travel."""
        low, high = -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high
        return min(max(place, low), high)

    def holds(self, place: float) -> bool:
        """Whether the position is within the travel."""
        return self.nearest(place) == place

    @property
    def middle(self) -> float | None:
        return None if self.low is None or self.high is None else (self.low + self.high) / 2


def axes_of(facts: Facts) -> dict[str, AxisTravel]:
    """The axes by name. Raises BadParameter."""
    prefixes = (AT, LOW, HIGH)
    names = {name.removeprefix(start): None for name in facts for start in prefixes if name.startswith(start)}
    return {name: AxisTravel(*(_number_or_none(facts, start + name) for start in prefixes)) for name in names}


RING = (-2.0, -1.0, 0.0, 1.0, 2.0)  # small turns of the focus ring about the initial focus; positive towards infinity


def ring_places(facts: Facts) -> Sequence[float]:
    """Turns of the focus ring, where the operator brackets the focus by it."""
    return RING if facts.get("focus_by", "ring") == "ring" else ()


def say_ring(change: float) -> str:
    """Instruction to turn the focus ring."""
    count = round(abs(change), 1)
    turns = "one small step" if count == 1 else f"{count:g} small steps"
    return f"Turn the focus ring {turns} towards {'infinity' if change > 0 else 'near'}."


def insisted_of(facts: Facts) -> frozenset[str]:
    """Names of the answers that the operator confirmed despite a contradiction."""
    return frozenset(name.removeprefix(INSISTED) for name in facts if name.startswith(INSISTED) and facts[name])


def gathered(read: Callable[[Facts], Any], *inputs: str, prefix: str = "") -> Any:
    """A field read from several facts whose names begin with `prefix`, and derived from `inputs`."""
    return field(default_factory=lambda: read({}), metadata={GATHERED: (read, prefix), INPUTS: inputs})


def gathered_numbers(prefix: str, *inputs: str) -> Any:
    """A field of the numbers whose names begin with `prefix`, by the rest of their names, derived from `inputs`."""

    def read(facts: Facts) -> Mapping[str, float]:
        return {name.removeprefix(prefix): number(facts, name) for name in facts if name.startswith(prefix)}

    return gathered(read, *inputs, prefix=prefix)


def derived_from(*inputs: str) -> Any:
    """A field that is dropped when one of these facts changes."""
    return field(default=None, metadata={INPUTS: inputs})


@dataclass(frozen=True)
class CameraFacts:
    """Facts of every plan about camera and rig, from the camera's metadata or from the operator."""

    camera: str | None = None
    lens: str | None = None
    exposure_s: float | None = None
    iso: float | None = None
    f_number: float | None = None  # from the camera's metadata
    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None
    distance_mm: float | None = None  # the rangefinder's reading
    axes: Mapping[str, AxisTravel] = gathered(axes_of)
    insisted: frozenset[str] = gathered(insisted_of)

    def where(self) -> dict[str, float]:
        """Positions of the axes, where known."""
        return {name: axis.at for name, axis in self.axes.items() if axis.at is not None}


def facts_as(kind: type[K], facts: Facts) -> K:
    """The typed facts of a plan; unknown ones keep their default. Raises BadParameter if a value has the wrong type."""
    read: dict[str, Any] = {}
    for name, (wanted, metadata) in _fields(kind).items():
        if GATHERED in metadata:
            read[name] = metadata[GATHERED][0](facts)
        elif name in facts:
            read[name] = _as(wanted, name, facts[name])
    return kind(**read)


def required(value: T | None, words: str, remedy: str) -> T:
    """The value if it is known. Raises BadParameter otherwise."""
    if value is None:
        raise BadParameter(f"{words} is not known", remedy)
    return value


def number(facts: Facts, name: str) -> float:
    """A fact that must be a number. Raises BadParameter."""
    return required(_number_or_none(facts, name), name, "repeat the step that measures it")


def dropped(kind: type[Any], changed: Collection[str], known: Collection[str]) -> frozenset[str]:
    """Names of the known facts derived, directly or indirectly, from the changed ones."""
    derived: set[str] = set()
    while True:
        inputs = {*changed, *derived}
        more = {
            name
            for own, (_, metadata) in _fields(kind).items()
            if inputs & set(metadata.get(INPUTS, ()))
            for name in known
            if name == own or (GATHERED in metadata and (start := metadata[GATHERED][1]) and name.startswith(start))
        }
        if more <= inputs:
            return frozenset(derived - set(changed))
        derived |= more


def _fields(kind: type[Any]) -> Mapping[str, tuple[Any, Mapping[str, Any]]]:
    hints = get_type_hints(kind)
    return {one.name: (_plain(hints[one.name]), one.metadata) for one in fields(kind)}


def _plain(hint: Any) -> Any:
    return next((arg for arg in get_args(hint) if arg is not NoneType), hint) if NoneType in get_args(hint) else hint


def _as(wanted: type[Fact], name: str, value: Fact) -> Fact:
    """A fact converted to its type. Raises BadParameter."""
    if wanted in (float, int) and isinstance(value, float | int) and not isinstance(value, bool):
        if math.isfinite(value) and (wanted is float or value == int(value)):
            return float(value) if wanted is float else int(value)
    elif isinstance(value, wanted):
        return value
    words = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}[wanted]
    raise BadParameter(f"{name} must be {words}; got {value!r}", "correct it where it was entered")


def _number_or_none(facts: Facts, name: str) -> float | None:
    return float(_as(float, name, facts[name])) if name in facts else None
