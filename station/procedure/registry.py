"""The procedures by name: the built-in ones, and those of installed packages (entry-point group `station.procedures`).

Each is imported when it is asked for.
"""

import importlib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from procedures.outcome import BadParameter
from station.procedure.base import Procedure

GROUP = "station.procedures"
BUILTIN: Mapping[str, str] = {
    "correct": "station.procedure.builtin.correct:PROCEDURE",
    "edge": "station.procedure.builtin.edge:PROCEDURE",
    "field": "station.procedure.builtin.field:PROCEDURE",
    "geometry": "station.procedure.builtin.geometry:PROCEDURE",
    "pattern": "station.procedure.builtin.pattern:PROCEDURE",
    "rays": "station.procedure.builtin.rays:PROCEDURE",
    "refocus": "station.procedure.builtin.refocus:PROCEDURE",
    "restore": "station.procedure.builtin.restore:PROCEDURE",
    "rig": "station.procedure.builtin.rig:PROCEDURE",
    "sensor": "station.procedure.builtin.sensor:PROCEDURE",
    "series": "station.procedure.builtin.series:PROCEDURE",
    "sharpen": "station.procedure.builtin.sharpen:PROCEDURE",
    "tilt": "station.procedure.builtin.tilt:PROCEDURE",
    "two-photo": "station.procedure.builtin.two_photo:PROCEDURE",
    "vignetting": "station.procedure.builtin.vignetting:PROCEDURE",
    "witnessed": "station.procedure.builtin.witnessed:PROCEDURE",
}
"""Name -> module and object, as an entry point names them."""


@cache
def added() -> dict[str, EntryPoint]:
    """Procedures of installed packages."""
    return {one.name: one for one in entry_points(group=GROUP) if one.name not in BUILTIN}


def procedure_names() -> list[str]:
    """All names, the built-in ones first."""
    return [*BUILTIN, *added()]


def procedure_named(name: str) -> Procedure[Any]:
    """The procedure of that name. Raises BadParameter if it is unknown."""
    if name in BUILTIN:
        module, _, attribute = BUILTIN[name].partition(":")
        loaded: Any = getattr(importlib.import_module(module), attribute)
    elif name in added():
        loaded = added()[name].load()
    else:
        raise BadParameter(f"there is no procedure {name!r}", f"use one of {', '.join(procedure_names())}")
    procedure: Procedure[Any] = loaded() if isinstance(loaded, type) else loaded
    return procedure
