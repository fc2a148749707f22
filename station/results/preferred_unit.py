"""The unit of frequencies from station.toml, used if neither a command nor a procedure states one.

```toml
unit = "lp/mm"                  # station.toml, above its devices; or "cycles/pixel" (of the plane), "lw/ph"
```
"""

from __future__ import annotations

from pathlib import Path

from procedures.outcome import BadParameter
from station.common.sanitise import printable
from station.common.toml_table import Table
from station.results.units import Unit

FILE = Path("station.toml")
"""Of the station, in the folder where the program is begun."""


def unit_named(name: str, where: str) -> Unit:
    """The unit of that name, in letters of any size. Raises BadParameter, saying where it stands."""
    try:
        return Unit(name.lower())
    except ValueError as error:
        reason = f"{where}: there is no unit {printable(name)!r}"
        raise BadParameter(reason, f"use one of {', '.join(Unit)}") from error


def preferred_unit(file: Path | None = None) -> Unit:
    """The unit that a station.toml asks for; the one in this folder where none is named. Cycles per pixel by default.

    Raises
    ------
    BadParameter
        If the file cannot be read, or there is no such unit.
    """
    if file is None and not FILE.is_file():
        return Unit.CYCLES
    path = file or FILE
    return unit_named(Table.read(path).get("unit", str, str(Unit.CYCLES)), f"{printable(path)}, unit")
