"""Limits of a result's numbers, with guard bands from their uncertainties.

A number meets its limit when even its uncertainty keeps it inside, and does not when even its uncertainty does not
bring it inside: JCGM 106:2012, guarded acceptance and guarded rejection. Between the two it is undecided. That is
about the lens; whether the measurement can be trusted is another verdict, and the two are never mixed.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from procedures.numbers import CYCLES, FAMILIES, HORIZONTAL, MTF, NUMBERS, VERTICAL, label, name_at
from procedures.outcome import Quantity
from station.results.comparison import UNMEASURED, Comparison, Compliance, Judgement, worst
from station.results.plane_result import PlaneResult
from station.results.units import Frequency, Pixels, Unit, convert_name, convert_quantity

BOTH = (HORIZONTAL, VERTICAL)
MIDDLE = 0.4
"""Fraction of the frame's half sides within which a place is in the middle."""


class Place(StrEnum):
    """Where in the frame a limit holds."""

    ANYWHERE = "anywhere"
    CENTRE = "centre"
    SIDES = "sides"
    CORNERS = "corners"


@dataclass(frozen=True)
class Limit:
    """The range in which a number must lie.

    number : one of `limited_numbers`
    least, most : infinite without a bound; frequencies in `unit`
    coverage : standard uncertainties on either side of the number that must lie inside too
    planes : where it holds; empty for every plane
    at : the frequency, in `unit`, at which the MTF is meant
    directions : in which a number of FAMILIES is meant
    place : where in the frame it holds
    """

    number: str
    least: float = -math.inf
    most: float = math.inf
    coverage: float = 2.0
    planes: Sequence[str] = ()
    at: float | None = None
    directions: Sequence[str] = BOTH
    place: Place = Place.ANYWHERE
    unit: Unit = Unit.CYCLES

    def to_record(self) -> dict[str, Any]:
        """Entry of a record; null without a bound."""
        entry: dict[str, Any] = {
            "number": self.number, "min": _bound(self.least), "max": _bound(self.most), "coverage": self.coverage,
            "planes": list(self.planes), "place": str(self.place), "unit": str(self.unit),
        }  # fmt: skip
        return entry | ({"at": self.at, "directions": list(self.directions)} if self.at is not None else {})

    def names(self, pixels: Pixels) -> list[str]:
        """The names of the numbers that are meant, best guess first: along directions, and without."""
        base = self.number
        if self.number == MTF:
            base = name_at(Frequency(self.at or 0.0, self.unit).per_pixel(pixels))
        return [f"{base}_{direction}" for direction in self.directions] if self.number in FAMILIES else [base]


@dataclass(frozen=True)
class Specification:
    """All limits of a lens or a camera.

    title : of what it is the specification
    source : its file, and sha256 of the content; empty for a part of another file
    """

    limits: tuple[Limit, ...] = ()
    title: str = ""
    source: str = ""
    sha256: str = ""

    @property
    def frequencies(self) -> tuple[Frequency, ...]:
        return tuple(dict.fromkeys(Frequency(limit.at, limit.unit) for limit in self.limits if limit.at is not None))

    @property
    def places(self) -> tuple[Place, ...]:
        """Those that are named."""
        return tuple(dict.fromkeys(limit.place for limit in self.limits))

    def to_record(self) -> dict[str, Any]:
        limits = [limit.to_record() for limit in self.limits]
        return {"title": self.title, "path": self.source, "sha256": self.sha256, "limits": limits}


@dataclass(frozen=True)
class Spot:
    """The numbers of one place of the frame.

    name : in words: "upper left corner"; empty if unknown
    places : what it counts as
    numbers : empty where it was not measured
    """

    name: str
    places: Sequence[Place]
    numbers: Mapping[str, Quantity] = field(default_factory=dict)


def limited_numbers() -> list[str]:
    """Quantities for which a limit can be set; values without an uncertainty have no guard band."""
    return list(dict.fromkeys((*FAMILIES, *NUMBERS)))


def compare(
    record: PlaneResult, specification: Specification, pixels: Pixels | None = None, spots: Sequence[Spot] = ()
) -> Comparison:
    """The plane against the limits that hold for it.

    Raises BadParameter if the unit of the limits needs unknown properties of the pixels.

    pixels : what its frequencies are counted in
    spots : the numbers by place, of a result over the frame; of one place, its numbers are the plane's
    """
    limits = [one for one in specification.limits if not one.planes or record.name in one.planes]
    if not limits:
        return Comparison()
    if not (record.numbers or record.values):
        return Comparison(Compliance.UNDECIDED)
    known = pixels or Pixels(record.pitch)
    judgements = tuple(one for limit in limits for one in _judge(record, limit, known, spots))
    return Comparison(worst(judgement.judged for judgement in judgements), judgements)


def place_of(x: float, y: float, shape: tuple[int, int]) -> Place:
    """Part of the frame at (x, y) of a plane (rows, columns): the frame is divided at 2/5 of its half sides."""
    rows, columns = shape
    u, v = abs(2 * x / max(columns - 1, 1) - 1), abs(2 * y / max(rows - 1, 1) - 1)
    return (Place.CENTRE, Place.SIDES, Place.CORNERS)[(u > MIDDLE) + (v > MIDDLE)]


def _judge(record: PlaneResult, limit: Limit, pixels: Pixels, spots: Sequence[Spot]) -> Iterator[Judgement]:
    """One judgement for each number and place that a limit is about."""
    meant = [one for one in spots if limit.place is Place.ANYWHERE or limit.place in one.places]
    if not spots:
        meant = [Spot("", list(Place), record.numbers)]
        if limit.place not in (Place.ANYWHERE, record.place):
            meant = [Spot(f"the {limit.place}", ())]
    names = limit.names(pixels)
    across = names[0].removesuffix(f"_{limit.directions[0]}") if limit.number in FAMILIES else names[0]
    for spot in meant:  # along directions, or across an edge; else the first is named as missing
        along = across not in spot.numbers and any(name in spot.numbers for name in names)
        for name in names if along else [across]:
            yield _of_number(record, limit, spot, name, pixels)


def _of_number(record: PlaneResult, limit: Limit, spot: Spot, name: str, pixels: Pixels) -> Judgement:
    quantity = _number(record, spot, name)
    is_frequency = limit.at is not None or (quantity is not None and quantity.unit == CYCLES)
    factor = pixels.factor(limit.unit) if is_frequency else 1.0
    shown = None if quantity is None else convert_quantity(quantity, limit.unit, factor)
    value, uncertainty = (None, 0.0) if shown is None else (shown.value, shown.uncertainty)
    judged = _judged(value, limit.coverage * uncertainty, limit)
    words = _words(limit, convert_name(name, factor), spot, judged, value, uncertainty)
    unit = shown.unit if shown is not None else ""
    return Judgement(
        convert_name(name, factor), judged, value, uncertainty, _bound(limit.least), _bound(limit.most), unit,
        spot.name, words,
    )  # fmt: skip


def _number(record: PlaneResult, spot: Spot, name: str) -> Quantity | None:
    """A number of a place; those without an uncertainty are the plane's."""
    if name in spot.numbers:
        return spot.numbers[name]
    return None if name in record.numbers else record.quantity(name)  # a number of another place is not this one's


def _bound(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _judged(value: float | None, band: float, limit: Limit) -> Compliance:
    """NaN, of value or band, is inside nothing and outside nothing."""
    if value is None:
        return Compliance.UNDECIDED
    if value - band >= limit.least and value + band <= limit.most:
        return Compliance.MEETS
    if value + band < limit.least or value - band > limit.most:
        return Compliance.MISSES
    return Compliance.UNDECIDED


def _words(limit: Limit, name: str, spot: Spot, judged: Compliance, value: float | None, uncertainty: float) -> str:
    bounds = [f"{sign} {bound:g}" for sign, bound in (("≥", limit.least), ("≤", limit.most)) if math.isfinite(bound)]
    number = NUMBERS.get(name)
    own = "" if number is None or number.unit in ("", "1") else f" {number.unit}"
    unit = f" {limit.unit}" if number is not None and number.unit == CYCLES else own
    where = f", {spot.name}" if spot.name else ""
    title = label(name, limit.unit)
    title = title.removesuffix(" across the edge") if value is None else title
    wanted = f"{title}{where} {' and '.join(bounds)}{unit}"
    if value is None:
        reason = UNMEASURED if spot.name and not spot.numbers else "there is no such number"
        return f"the limit {wanted} cannot be judged: {reason}"
    got = f"{value:.4g} ± {uncertainty:.2g}" if uncertainty else f"{value:.4g}"
    if judged is Compliance.MEETS:
        return f"{wanted} is met: {got}"
    if judged is Compliance.MISSES:
        return f"the limit {wanted} is missed: {got}"
    return f"the limit {wanted} is not surely met: {got} is within {limit.coverage:g} uncertainties of it"
