"""A specification as a file says it: limits of numbers, at frequencies and places, by plane.

```toml
title = "50 mm f/1.8 at f/5.6"
coverage = 2                        # guard bands, in standard uncertainties
unit = "cycles/pixel"               # of every frequency in here: of the colour plane; or "lp/mm", "lw/ph"

[limits]                            # anywhere, one for each number
energy_above_nyquist = { max = 0.05, planes = ["G1", "G2"] }

[[limit]]                           # as many as there are
number = "mtf"
at = 0.25
min = 0.5
place = "centre"                    # or "sides", "corners", "anywhere"
```
"""

import hashlib
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from procedures.numbers import DIRECTIONS, FAMILIES, MTF
from procedures.outcome import BadInput, BadParameter
from procedures.raw import GREY_PLANE, MOSAIC_PLANES
from procedures.reading.text import read_text
from station.common.models import ModelField, TableSource, fields_of, one_of, read_model, read_value
from station.common.sanitise import printable
from station.common.toml_text import KeyPath
from station.results.limits import BOTH, Limit, Place, Specification, limited_numbers
from station.results.units import Unit

PLANES = (*MOSAIC_PLANES, GREY_PLANE)
FrequencyValue = Annotated[float, Meta(ge=0)]
UnitName = Annotated[str, one_of(lambda: Unit)]
PlaneName = Annotated[str, one_of(lambda: PLANES)]
DirectionName = Annotated[str, one_of(lambda: DIRECTIONS)]
PlaceName = Annotated[str, one_of(lambda: Place)]
NumberName = Annotated[str, Meta(extra={"one_of": limited_numbers, "example": '"mtf50"'})]
WITHOUT_FREQUENCY = one_of(lambda: [number for number in limited_numbers() if number != MTF])


@dataclass(frozen=True, kw_only=True)
class LimitTable:
    """Limit of the number that is its key."""

    min: float = -math.inf
    max: float = math.inf
    at: FrequencyValue | None = None
    planes: tuple[PlaneName, ...] = ()
    directions: tuple[DirectionName, ...] = ()
    place: PlaceName = Place.ANYWHERE


@dataclass(frozen=True, kw_only=True)
class NumberedLimitTable(LimitTable):
    """Limit of a number."""

    number: NumberName


@dataclass(frozen=True, kw_only=True)
class SpecificationTable:
    """A specification, its own file or a part of a procedure file."""

    title: str = ""
    coverage: Annotated[float, Meta(ge=0, extra={"example": "2"})] = 2.0
    unit: UnitName = Unit.CYCLES
    limits: Annotated[dict[str, LimitTable], WITHOUT_FREQUENCY] = field(default_factory=dict)
    limit: tuple[NumberedLimitTable, ...] = ()

    def to_specification(self, source: TableSource) -> Specification:
        """The limits. Raises BadParameter if one is inconsistent."""
        short = self.limits.items()
        rows: list[tuple[KeyPath, str, LimitTable]] = [(("limits", name), name, row) for name, row in short]
        rows += [(("limit", n), row.number, row) for n, row in enumerate(self.limit)]
        return Specification(tuple(self._limit(number, row, source, path) for path, number, row in rows), self.title)

    def _limit(self, number: str, row: LimitTable, source: TableSource, path: KeyPath) -> Limit:
        if not row.min <= row.max or (math.isinf(row.min) and math.isinf(row.max)):
            source.refuse((*path, "min"), "and max must leave a range", "give min, max, or min below max")
        if (number == MTF) is not (row.at is not None):
            source.refuse((*path, "at"), f'is the frequency of number = "{MTF}"', "give it there, and nowhere else")
        if row.directions and number not in FAMILIES:
            remedy = "the name of this number gives its own"
            source.refuse((*path, "directions"), f"go with {', '.join(FAMILIES)}", remedy)
        return Limit(
            number, row.min, row.max, self.coverage, row.planes, row.at, row.directions or BOTH, Place(row.place),
            Unit(self.unit),
        )  # fmt: skip


def read_specification(path: Path) -> Specification:
    """The specification in a file. Raises BadParameter if it is unreadable, has an invalid key or value, or sets no
    limit."""
    return parse_specification(specification_text(path), str(path))


def specification_text(path: Path) -> str:
    """The text of a file. Raises BadParameter if it cannot be read."""
    try:
        return read_text(path, "specification", "name another file")
    except BadInput as error:
        raise BadParameter(printable(error.reason), error.remedy) from error


def parse_specification(text: str, file: str) -> Specification:
    """The specification in the text of a file. Raises BadParameter as `read_specification` does."""
    content, source = TableSource.parse(text, file)
    specification = read_model(SpecificationTable, content, source).to_specification(source)
    if not specification.limits:
        raise BadParameter(f"{printable(file)} sets no limit", "write [[limit]] tables; station init shows them")
    title = specification.title or Path(file).name
    return replace(specification, title=title, source=file, sha256=hashlib.sha256(text.encode()).hexdigest())


# ```toml
# unit = "lp/mm"                  # station.toml, above its devices; or "cycles/pixel" (of the plane), "lw/ph"
# ```

FILE = Path("station.toml")
UNIT: ModelField = next(one for one in fields_of(SpecificationTable) if one.name == "unit")


def unit_named(name: Any, source: TableSource) -> Unit:
    """The unit of that name, in letters of any size. Raises BadParameter."""
    return Unit(read_value(UNIT, name, source, ("unit",)))


def preferred_unit(file: Path | None = None) -> Unit:
    """The unit of a station.toml, by default this folder's, else cycles per pixel. Raises BadParameter if it is
    unreadable or unknown."""
    if file is None and not FILE.is_file():
        return Unit.CYCLES
    content, source = TableSource.read(file or FILE)
    return unit_named(content.get("unit", Unit.CYCLES), source)
