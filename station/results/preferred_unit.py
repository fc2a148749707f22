"""The unit of frequencies from station.toml, used if neither a command nor a procedure states one.

```toml
unit = "lp/mm"                  # station.toml, above its devices; or "cycles/pixel" (of the plane), "lw/ph"
```
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from station.common.models import ModelField, TableSource, fields_of, read_value
from station.results.specification_file import SpecificationTable
from station.results.units import Unit

FILE = Path("station.toml")
"""The station's file of settings, in the working directory."""
UNIT: ModelField = next(one for one in fields_of(SpecificationTable) if one.name == "unit")


def unit_named(name: Any, source: TableSource) -> Unit:
    """The unit of that name, in letters of any size. Raises BadParameter."""
    return Unit(read_value(UNIT, name, source, ("unit",)))


def preferred_unit(file: Path | None = None) -> Unit:
    """The unit that a station.toml asks for; the one in this folder where none is named. Cycles per pixel by default.

    Raises BadParameter if the file cannot be read, or there is no such unit.
    """
    if file is None and not FILE.is_file():
        return Unit.CYCLES
    content, source = TableSource.read(file or FILE)
    return unit_named(content.get("unit", Unit.CYCLES), source)
