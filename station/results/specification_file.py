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

from __future__ import annotations

import difflib
import hashlib
import math
from pathlib import Path

from procedures.numbers import DIRECTIONS, FAMILIES, MTF
from procedures.outcome import BadInput, BadParameter
from procedures.raw import GREY_PLANE, MOSAIC_PLANES
from procedures.reading.text import read_text
from station.common.sanitise import printable
from station.common.toml_table import TomlTable
from station.results.limits import BOTH, Limit, Place, Specification, limited_numbers
from station.results.units import Unit

PLANES = (*MOSAIC_PLANES, GREY_PLANE)


def read_specification(path: Path) -> Specification:
    """The specification in a file.

    Raises
    ------
    BadParameter
        If it cannot be read, has a key that is not known or a value that cannot be meant, or sets no limit.
    """
    return parse_specification(specification_text(path), str(path))


def specification_text(path: Path) -> str:
    """The text of a file. Raises BadParameter if it cannot be read."""
    try:
        return read_text(path, "specification", "name another file")
    except BadInput as error:
        raise BadParameter(printable(error.reason), error.remedy) from error


def parse_specification(text: str, source: str) -> Specification:
    """The specification in the text of a file, `source` its path. Raises BadParameter as `read_specification` does."""
    table = TomlTable.parse(text, source)
    specification = specification_in(table, Path(source).name)
    table.end()
    if not specification.limits:
        raise BadParameter(f"{printable(source)} sets no limit", "write [[limit]] tables; station init shows them")
    return Specification(specification.limits, specification.title, source, hashlib.sha256(text.encode()).hexdigest())


def specification_in(table: TomlTable, title: str = "") -> Specification:
    """The specification that a table holds, its own file or a part of a procedure. Raises BadParameter."""
    coverage, unit = table.get("coverage", float, 2.0), _unit(table)
    if not 0 <= coverage < math.inf:
        raise table.wrong("coverage", f"must not be negative; it is {coverage:g}", "2 leaves 2.5 % on either side")
    title = table.get("title", str, title)
    short = table.table("limits").tables([one for one in limited_numbers() if one != MTF])
    limits = [_limit(name, one, coverage, unit) for name, one in short.items()]
    limits += [_limit(_number(one), one, coverage, unit) for one in table.list_of_tables("limit")]
    return Specification(tuple(limits), title)


def _unit(table: TomlTable) -> Unit:
    name = table.get("unit", str, str(Unit.CYCLES))
    try:
        return Unit(name.lower())
    except ValueError as error:
        raise table.wrong("unit", f"is {printable(name)!r}", f"use one of {', '.join(Unit)}") from error


def _number(table: TomlTable) -> str:
    name = table.get("number", str, "")
    if name not in (known := limited_numbers()):
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
        remedy = f"did you mean {' or '.join(near)}?" if near else "station manual numbers lists them"
        raise table.wrong("number", f"is {printable(name)!r}, which is no number", remedy)
    return name


def _limit(name: str, table: TomlTable, coverage: float, unit: Unit) -> Limit:
    least, most = table.get("min", float, -math.inf), table.get("max", float, math.inf)
    planes, directions = _words(table, "planes", PLANES), _words(table, "directions", tuple(DIRECTIONS))
    at = table.get("at", float, 0.0) if table.has("at") else None
    place = _words(table, "place", tuple(Place))
    table.end()
    if not least <= most or (math.isinf(least) and math.isinf(most)):
        raise table.wrong("min", "and max must leave a range", "give min, max, or min below max")
    if (name == MTF) is not (at is not None) or (at is not None and not 0 <= at < math.inf):
        raise table.wrong("at", f'is the frequency of number = "{MTF}"', "give it there, and nowhere else")
    if directions and name not in FAMILIES:
        raise table.wrong("directions", f"go with {', '.join(FAMILIES)}", "the name of this number says its own")
    where = Place(place[0]) if place else Place.ANYWHERE
    return Limit(name, least, most, coverage, planes, at, directions or BOTH, where, unit)


def _words(table: TomlTable, key: str, known: tuple[str, ...]) -> tuple[str, ...]:
    """A list of words, or one word, out of known ones."""
    words = table.words(key) if isinstance(table.peek(key), list) else (table.get(key, str, ""),)
    for word in words:
        if word and word not in known:
            raise table.wrong(key, f"has {printable(word)!r}", f"use one of {', '.join(known)}")
    return tuple(word for word in words if word)
