"""What looks at the chart from several distances tell beside laser and rail: the laser's offset from the lens. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.pattern_psf.facts import LOOKS, PatternFacts, RangeLook
from procedures.pattern_psf.pose import Optics
from procedures.plan import Fact, Facts, Reading

LASER_REACH_MM = 300.0
"""How far before or behind the lens a rangefinder on its carriage is."""
APART = 0.05
"""Of the chart's size, between looks that tell more together than each alone."""


def look_now(px_per_cell: float, known: PatternFacts) -> RangeLook:
    """This look at the chart."""
    rail = known.axes.get("z_mm")
    return RangeLook(px_per_cell, known.distance_mm, None if rail is None else rail.at)


def range_facts(look: RangeLook, optics: Optics, known: PatternFacts) -> dict[str, Fact]:
    """This look for those that follow; with a laser also its offset from the lens, by this look and those before it.

    With the focus left alone the image lies F pixels behind the lens, whatever the distance z: px = F cell / z, and
    the laser reads z + offset. Looks from distances that differ by a twentieth give F cell and the offset as the
    line's slope and intercept; before that the lens's data do, as if it were focused here.
    """
    looks = (*known.looks, look)
    name = f"{LOOKS}{len(looks)}"
    new: dict[str, Fact] = {f"{LOOKS}looks": float(len(looks)), f"{name}_cell_px": look.px_per_cell}
    if look.rail_mm is not None:
        new[f"{name}_rail_mm"] = look.rail_mm
    if look.laser_mm is None:
        return new
    offset = fit_offset_mm([(one.px_per_cell, one.laser_mm) for one in looks if one.laser_mm is not None])
    by_lens = look.laser_mm - optics.distance_mm(look.px_per_cell)
    return new | {f"{name}_laser_mm": look.laser_mm, "laser_offset_mm": by_lens if offset is None else offset}


def fit_offset_mm(pairs: Sequence[tuple[float, float]]) -> float | None:
    """Where laser readings (mm) over pixels per cell would lie for the lens itself; None from hardly one distance."""
    px, laser = np.array(pairs).T
    if np.ptp(px) < APART * px.mean():
        return None
    _, offset = np.polyfit(1 / px, laser, 1)
    return float(offset)


def range_readings(learned: Facts) -> tuple[Reading, ...]:
    """The laser's offset, where there is a laser."""
    if "laser_offset_mm" not in learned:
        return ()
    offset_mm = float(learned["laser_offset_mm"])
    return (Reading("laser behind lens", offset_mm, "mm", -LASER_REACH_MM, LASER_REACH_MM),)


def without_offset(learned: Facts) -> Facts:
    """The same but for an offset that cannot be."""
    return {name: value for name, value in learned.items() if name != "laser_offset_mm"}
