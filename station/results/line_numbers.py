"""The numbers of a plane that are stated in one line with its verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.numbers import RADIAL, Group, frequency_of, in_group, label
from station.common.uncertainty_text import stated

if TYPE_CHECKING:
    from station.results.plane_result import PlaneResult


def line_numbers(plane: PlaneResult) -> list[str]:
    """The numbers of the group LINE and the MTF at requested frequencies: "MTF50 0.412 ± 0.003 cycles/pixel"."""
    requested = [name for name in plane.numbers if (at := frequency_of(name)) and at[1] != RADIAL]
    lines = []
    for name in (*in_group(Group.LINE, {**plane.numbers, **plane.values}), *requested):
        if (number := plane.quantity(name)) is not None:
            words = f"{label(name, plane.unit)} {stated(number.value, number.uncertainty)}"
            lines.append(f"{words} {number.unit}" if number.unit != "1" else words)
    return lines
