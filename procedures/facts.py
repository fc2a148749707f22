"""Typed facts of a plan: the facts in the journal, by name, become one frozen dataclass per plan.

A session stores facts by name as JSON. A plan reads them into its dataclass, with one field per name, None where it is
unknown. Each field declares the inputs from which the fact is derived; the fact is dropped when one of them changes.
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
"""Prefix of a name: the operator confirmed that answer despite a contradiction."""
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
        """Middle of the travel."""
        return None if self.low is None or self.high is None else (self.low + self.high) / 2


def axes_of(facts: Facts) -> dict[str, AxisTravel]:
    """The axes by name. Raises BadParameter."""
    prefixes = (AT, LOW, HIGH)
    names = {name.removeprefix(start): None for name in facts for start in prefixes if name.startswith(start)}
    return {name: AxisTravel(*(_number_or_none(facts, start + name) for start in prefixes)) for name in names}


def insisted_of(facts: Facts) -> frozenset[str]:
    """Names of the answers that the operator confirmed despite a contradiction."""
    return frozenset(name.removeprefix(INSISTED) for name in facts if name.startswith(INSISTED) and facts[name])


def gathered(read: Callable[[Facts], Any], *inputs: str, prefix: str = "") -> Any:
    """A field read from several facts whose names begin with `prefix`, and derived from `inputs`."""
    return field(default_factory=lambda: read({}), metadata={GATHERED: (read, prefix), INPUTS: inputs})


def gathered_numbers(prefix: str) -> Any:
    """A field of the numbers whose names begin with `prefix`, by the rest of their names."""

    def read(facts: Facts) -> Mapping[str, float]:
        return {name.removeprefix(prefix): number(facts, name) for name in facts if name.startswith(prefix)}

    return gathered(read, prefix=prefix)


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
    f_number: float | None = None
    """From the camera's metadata."""
    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None
    distance_mm: float | None = None
    """The rangefinder's reading."""
    axes: Mapping[str, AxisTravel] = gathered(axes_of)
    insisted: frozenset[str] = gathered(insisted_of)

    def where(self) -> dict[str, float]:
        """Positions of the axes, where known."""
        return {name: axis.at for name, axis in self.axes.items() if axis.at is not None}


def facts_as(kind: type[K], facts: Facts) -> K:
    """The typed facts of a plan; unknown ones keep the default of their field.

    Raises BadParameter if a value has the wrong type.
    """
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
    """Type and metadata of each field by name."""
    hints = get_type_hints(kind)
    return {one.name: (_plain(hints[one.name]), one.metadata) for one in fields(kind)}


def _plain(hint: Any) -> Any:
    """The type without None."""
    return next((one for one in get_args(hint) if one is not NoneType), hint) if NoneType in get_args(hint) else hint


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
