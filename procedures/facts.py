"""What is known while a plan is carried out, typed: the journal's facts by name become one frozen dataclass a plan.

A session keeps facts by name, as JSON can hold them. A plan reads them at its door into its own dataclass: a field for
each name, None where it is not known. What a fact was derived from stands beside its field, so that it is dropped when
one of these inputs changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields
from types import NoneType
from typing import Any, TypeVar, get_args, get_type_hints

from procedures.outcome import BadParameter
from procedures.plan import Fact, Facts

K = TypeVar("K")
T = TypeVar("T")
AT, LOW, HIGH = "at_", "low_", "high_"
INSISTED = "insisted_"
"""Before a name: the fact that the operator's answer holds against what contradicts it."""
INPUTS, GATHERED = "inputs", "gathered"


@dataclass(frozen=True)
class AxisTravel:
    """Where an axis is, and the ends of its travel, in the unit that its name carries; None where it is not known."""

    at: float | None = None
    low: float | None = None
    high: float | None = None

    def nearest(self, place: float) -> float:
        """The place of its travel that is nearest to this one."""
        low, high = -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high
        return min(max(place, low), high)

    def holds(self, place: float) -> bool:
        """Whether it can go there."""
        return self.nearest(place) == place

    @property
    def middle(self) -> float | None:
        """Of its travel."""
        return None if self.low is None or self.high is None else (self.low + self.high) / 2


def axes_of(facts: Facts) -> dict[str, AxisTravel]:
    """The axes by name. Raises BadParameter."""
    prefixes = (AT, LOW, HIGH)
    names = {name.removeprefix(start): None for name in facts for start in prefixes if name.startswith(start)}
    return {name: AxisTravel(*(_number_or_none(facts, start + name) for start in prefixes)) for name in names}


def insisted_of(facts: Facts) -> frozenset[str]:
    """The names on whose values the operator insists."""
    return frozenset(name.removeprefix(INSISTED) for name in facts if name.startswith(INSISTED) and facts[name])


def gathered(read: Callable[[Facts], Any], *inputs: str, prefix: str = "") -> Any:
    """A field that is read from several facts, whose names all begin with `prefix`; it is derived from `inputs`."""
    return field(default_factory=lambda: read({}), metadata={GATHERED: (read, prefix), INPUTS: inputs})


def derived_from(*inputs: str) -> Any:
    """A field that is None where it is not known, and not known any more when one of these facts changes."""
    return field(default=None, metadata={INPUTS: inputs})


@dataclass(frozen=True)
class CameraFacts:
    """What any plan knows of its camera and rig: as the camera noted it, or as it was typed."""

    camera: str | None = None
    lens: str | None = None
    exposure_s: float | None = None
    iso: float | None = None
    f_number: float | None = None
    """As the camera noted it."""
    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None
    distance_mm: float | None = None
    """The rangefinder's reading."""
    axes: Mapping[str, AxisTravel] = gathered(axes_of)
    insisted: frozenset[str] = gathered(insisted_of)

    def where(self) -> dict[str, float]:
        """Where the axes are, of those that tell."""
        return {name: axis.at for name, axis in self.axes.items() if axis.at is not None}


def facts_as(kind: type[K], facts: Facts) -> K:
    """The facts of a plan, each of its own type; what is not known keeps its field's default.

    Raises
    ------
    BadParameter
        If a value is none of its field's kind, naming it.
    """
    read: dict[str, Any] = {}
    for name, (wanted, metadata) in _fields(kind).items():
        if GATHERED in metadata:
            read[name] = metadata[GATHERED][0](facts)
        elif name in facts:
            read[name] = _as(wanted, name, facts[name])
    return kind(**read)


def required(value: T | None, words: str, remedy: str) -> T:
    """The value of something that must be known. Raises BadParameter where it is not."""
    if value is None:
        raise BadParameter(f"{words} is not known", remedy)
    return value


def number(facts: Facts, name: str) -> float:
    """A fact that must be a number. Raises BadParameter."""
    return required(_number_or_none(facts, name), name, "take the step again that tells it")


def dropped(kind: type[Any], changed: Collection[str], known: Collection[str]) -> frozenset[str]:
    """The names of known facts that were derived from the changed ones, or from what was derived from these."""
    found: set[str] = set()
    while True:
        inputs = {*changed, *found}
        more = {
            name
            for own, (_, metadata) in _fields(kind).items()
            if inputs & set(metadata.get(INPUTS, ()))
            for name in known
            if name == own or (GATHERED in metadata and (start := metadata[GATHERED][1]) and name.startswith(start))
        }
        if more <= inputs:
            return frozenset(found - set(changed))
        found |= more


def _fields(kind: type[Any]) -> Mapping[str, tuple[Any, Mapping[str, Any]]]:
    """By name: of what type a fact is, and what is declared of it."""
    hints = get_type_hints(kind)
    return {one.name: (_plain(hints[one.name]), one.metadata) for one in fields(kind)}


def _plain(hint: Any) -> Any:
    """The type of a value that may be None."""
    return next((one for one in get_args(hint) if one is not NoneType), hint) if NoneType in get_args(hint) else hint


def _as(wanted: type[Fact], name: str, value: Fact) -> Fact:
    """A fact as what it is meant to be. Raises BadParameter."""
    if wanted in (float, int) and isinstance(value, float | int) and not isinstance(value, bool):
        if math.isfinite(value) and (wanted is float or value == int(value)):
            return float(value) if wanted is float else int(value)
    elif isinstance(value, wanted):
        return value
    words = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}[wanted]
    raise BadParameter(f"{name} must be {words}; got {value!r}", "correct it where it was given")


def _number_or_none(facts: Facts, name: str) -> float | None:
    return float(_as(float, name, facts[name])) if name in facts else None
