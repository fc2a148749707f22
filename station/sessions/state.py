"""The state of a session, replayed from its journal line by line, without side effects."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from procedures.choice import with_frequencies
from procedures.outcome import ProcedureError
from procedures.plan import Fact
from station.common.models import TableSource
from station.results.plane_result import PlaneResult, curves_of, numbers_of
from station.results.specification_file import parse_specification, specification_text, unit_named
from station.results.terms import USUAL, Terms
from station.results.units import Pixels, Unit
from station.sessions.journal import Damaged, JournalLine
from station.sessions.layout import is_given, read_config

ORIGINAL = re.compile(r"originals/[A-Za-z0-9][A-Za-z0-9._-]*")
DERIVED = re.compile(r"derived/[1-9][0-9]{0,5}")
RETAKEN = "put aside for a retake"
LOST = "its photograph is lost"


@dataclass(frozen=True)
class SessionShot:
    """One photograph of the session.

    number : counted from 1 in the order of the exposures
    path : relative to the session's folder, inside originals/
    purpose, step : why it was taken
    counts : whether the result uses it; None until it was judged
    reason : why it does not count
    exposure : times of request and reception by the bench's clock, settings, shutter times, source
    snapshot : state of the devices at that time
    lost : whether its photograph was given up
    """

    number: int
    path: str
    sha256: str
    size_bytes: int
    purpose: str
    step: str
    counts: bool | None = None
    reason: str = ""
    exposure: Mapping[str, Any] = field(default_factory=dict)
    snapshot: Mapping[str, Any] = field(default_factory=dict)
    lost: bool = False


@dataclass(frozen=True)
class DerivedResult:
    """One result: its folder relative to the session's, the SHA-256 of its files, its shots and step. `about` holds
    further data of the journal: verdicts, duration, machine."""

    folder: str
    files: Mapping[str, str]
    shots: tuple[int, ...]
    step: str
    verdict: str
    at: str
    about: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Awaited:
    """A requested exposure whose photograph is not in the session (yet)."""

    step: str
    purpose: str


@dataclass(frozen=True)
class SessionState:
    """A session according to its journal.

    plan, camera, lens : the plan and its subject
    began : when it was created, UTC, ISO 8601
    seed : of all random numbers in it
    done : names of the finished steps, in order
    step : name of the unfinished step, "" if none
    facts : known facts, by name
    standing : the last result, as long as neither facts nor shots have changed since
    adopting : a shot that is being adopted, usually None
    awaited : a requested exposure that has not arrived, usually None
    notices : messages that the operator has not acknowledged: repeated exposures, unknown files, an incomplete line
    given : hashes of files referred to by answers, by path
    ended : how the plan ended, None while it has not
    """

    plan: str
    camera: str
    lens: str
    began: str
    seed: int
    done: tuple[str, ...] = ()
    step: str = ""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    shots: tuple[SessionShot, ...] = ()
    results: tuple[DerivedResult, ...] = ()
    standing: DerivedResult | None = None
    adopting: SessionShot | None = None
    awaited: Awaited | None = None
    notices: tuple[str, ...] = ()
    strangers: Mapping[str, str] = field(default_factory=dict)
    given: Mapping[str, str] = field(default_factory=dict)
    ended: str | None = None

    @property
    def empty(self) -> bool:
        """Whether nothing was answered, photographed or done, and no emergency ended it."""
        contents = (self.done, self.facts, self.shots, self.results, self.adopting, self.awaited)
        return not any(contents) and self.ended != "emergency"

    def shot(self, number: int) -> SessionShot:
        """The shot of that number. Raises KeyError."""
        for shot in self.shots:
            if shot.number == number:
                return shot
        raise KeyError(number)

    def counting(self) -> tuple[SessionShot, ...]:
        """The shots used by results."""
        return tuple(shot for shot in self.shots if shot.counts)

    @property
    def next_number(self) -> int:
        return max((shot.number for shot in self.shots), default=0) + 1


def replay(lines: Iterable[JournalLine]) -> SessionState:
    """The state after all lines. Raises Damaged if one is inconsistent."""
    state: SessionState | None = None
    for line in lines:
        try:
            state = _created(line) if state is None else after(state, line)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise Damaged(
                f"line {line.seq} of the journal ({line.event}) cannot be understood: {error!r}",
                "it may come from a newer version of the program: update, or bring the journal back from a copy",
            ) from error
    if state is None:
        raise Damaged("the journal has no line", "bring it back from a copy")
    return state


def _created(line: JournalLine) -> SessionState:
    if line.event != "created":
        raise ValueError("a journal begins with `created`")
    plan, camera, lens, began = (str(line.data[name]) for name in ("plan", "camera", "lens", "began"))
    return SessionState(plan, camera, lens, began, int(line.data["seed"]))


def after(state: SessionState, line: JournalLine) -> SessionState:
    """The state after one more line; unrelated events leave it unchanged."""
    change = CHANGES.get(line.event)
    if change is None:
        return state
    changed = change(state, line)
    untouched = changed.facts is state.facts and changed.counting() == state.counting()
    return changed if untouched else replace(changed, standing=None)


def _forgot(state: SessionState, line: JournalLine) -> SessionState:
    gone = set(line.data["names"])
    return replace(state, facts={name: fact for name, fact in state.facts.items() if name not in gone})


def _reopened(state: SessionState, line: JournalLine) -> SessionState:
    """Schedule the steps from this one on again: their shots stay, but no longer count."""
    name = str(line.data["step"])
    steps = (*state.done, *([state.step] if state.step else []))
    again = steps[steps.index(name) :] if name in steps else ()
    shots = tuple(
        replace(shot, counts=False, reason=RETAKEN) if shot.step in again and shot.counts is not False else shot
        for shot in state.shots
    )
    done = tuple(step for step in state.done if step not in again)
    return replace(state, done=done, step="", shots=shots, ended=None)


def _adopted(state: SessionState, line: JournalLine) -> SessionState:
    shot = state.adopting
    if shot is None or shot.number != line.data["shot"]:
        raise ValueError("no shot was being adopted")
    return replace(state, adopting=None, awaited=None, shots=(*state.shots, shot))


def _with_shot(state: SessionState, line: JournalLine, **change: Any) -> SessionState:
    old = state.shot(line.data["shot"])
    return replace(state, shots=tuple(replace(shot, **change) if shot is old else shot for shot in state.shots))


def _derived(state: SessionState, line: JournalLine) -> SessionState:
    data = dict(line.data)
    folder = str(data.pop("folder"))
    if not DERIVED.fullmatch(folder):
        raise ValueError(f"results must be in derived/, not in {folder}")
    names = {name: str(data.pop(name)) for name in ("step", "verdict")}
    files, shots = dict(data.pop("files")), tuple(int(number) for number in data.pop("shots"))
    result = DerivedResult(folder, files, shots, **names, at=line.at, about=data)
    return replace(state, results=(*state.results, result), standing=result)


def _given(state: SessionState, line: JournalLine) -> SessionState:
    files = {str(path): str(digest) for path, digest in line.data["files"].items()}
    if not all(map(is_given, files)):
        raise ValueError(f"files of answers must be in given/, not in {', '.join(files)}")
    return replace(state, given={**state.given, **files})


CHANGES: Mapping[str, Callable[[SessionState, JournalLine], SessionState]] = {
    "acknowledged": lambda state, line: replace(state, notices=()),
    "told": lambda state, line: replace(state, notices=()),  # older sessions
    "noticed": lambda state, line: replace(state, notices=(*state.notices, str(line.data["say"]))),
    "learned": lambda state, line: replace(state, facts={**state.facts, **line.data["facts"]}),
    "forgot": _forgot,
    "step_began": lambda state, line: replace(state, step=str(line.data["step"]), ended=None),
    "step_ended": lambda state, line: replace(
        state, step="", done=(*(step for step in state.done if step != line.data["step"]), str(line.data["step"]))
    ),
    "reopened": _reopened,
    "exposing": lambda state, line: replace(state, awaited=Awaited(str(line.data["step"]), str(line.data["purpose"]))),
    "gave_up": lambda state, line: replace(state, awaited=None, adopting=None),
    "adopting": lambda state, line: replace(state, adopting=_shot(line.data)),
    "adopted": _adopted,
    "judged": lambda state, line: _with_shot(
        state, line, counts=bool(line.data["counts"]), reason=str(line.data["reason"])
    ),
    "lost": lambda state, line: _with_shot(state, line, counts=False, reason=LOST, lost=True),
    "derived": _derived,
    "found": lambda state, line: replace(
        state, strangers={**state.strangers, str(line.data["path"]): str(line.data["sha256"])}
    ),
    "given": _given,
    "ended": lambda state, line: replace(state, ended=str(line.data["how"])),
}


def _shot(data: Mapping[str, Any]) -> SessionShot:
    path = str(data["path"])
    if not ORIGINAL.fullmatch(path):
        raise ValueError(f"photographs must be in originals/, not in {path}")
    return SessionShot(
        int(data["shot"]), path, str(data["sha256"]), int(data["size_bytes"]), str(data["purpose"]),
        str(data["step"]), exposure=dict(data["exposure"]), snapshot=dict(data["snapshot"]),
    )  # fmt: skip


KEY = "specification"
UNIT = "unit"


def frozen(path: Path) -> dict[str, str]:
    """A specification as frozen in a session. Raises BadParameter if it is invalid."""
    text = specification_text(path)
    parse_specification(text, str(path))
    return {"path": str(path), "text": text}


def terms_of_session(folder: Path) -> Terms:
    """The terms of a session's results, or the default. Raises BadParameter for an invalid unit or specification."""
    config, _ = read_config(folder)
    frozen_config = config.get("config", {})
    unit = unit_named(frozen_config.get(UNIT, Unit.CYCLES), TableSource(places={UNIT: (f"{folder}, {UNIT}",)}))
    specification: Mapping[str, Any] = frozen_config.get(KEY, {})
    if not isinstance(specification, Mapping) or not isinstance(specification.get("text"), str):
        return USUAL if unit is Unit.CYCLES else Terms(unit)
    return Terms(unit, specification=parse_specification(specification["text"], str(specification.get("path", ""))))


def in_terms(result: PlaneResult, terms: Terms, pixels: Pixels) -> PlaneResult:
    """Express a plane's result in these terms. If the unit requires an unknown, limits stay undecided for that reason,
    frequencies are in cycles per pixel."""
    terms = terms.with_known_unit(pixels)
    if not terms.specification.limits:
        return terms.apply(result, pixels)
    try:
        at = terms.frequencies(pixels)
    except ProcedureError as error:
        return terms.undecided(result, error.reason)
    if result.psf is not None and result.quality is not None and at:
        quality = with_frequencies(result.quality, result.psf, at)
        numbers = dict(numbers_of(quality, result.pitch))
        result = replace(result, quality=quality, numbers=numbers, curves=curves_of(quality))
    return terms.apply(result, pixels)
