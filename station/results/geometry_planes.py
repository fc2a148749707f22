"""The planes of a geometry's result: which one is meant, and what its tables are called."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput, BadParameter


def table_prefix(plane: str, count: int) -> str:
    """Prefix of the names of a plane's tables, in a result of `count` planes."""
    return "geometry_" if count == 1 else f"geometry_{plane}_"


def plane_entry(planes: Mapping[str, Any], plane: str | None, record: Path) -> tuple[str, Mapping[str, Any]]:
    """The name and entry of the plane that is asked for; None for green, or the first there is.

    Raises BadInput if the record has no plane; BadParameter if it has not this plane.
    """
    if not planes:
        raise BadInput(f"{record} contains no plane", "name the folder that station geometry wrote")
    name = plane or ("G1" if "G1" in planes else next(iter(planes)))
    if name not in planes:
        raise BadParameter(f"{record} has the planes {', '.join(planes)}, not {name!r}", "name one of these")
    return name, planes[name]
