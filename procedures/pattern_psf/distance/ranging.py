"""Offset of the laser from the lens, from observations of the chart at several distances. Pure."""

from collections.abc import Sequence

import numpy as np

from procedures.pattern_psf.facts import LOOKS, PatternFacts, RangeLook
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import Fact, Facts, Reading

LASER_REACH_MM = 300.0  # greatest plausible offset of a rangefinder from the lens along the axis
MIN_DIFFERENCE = 0.05  # least relative difference of the chart's size between two observations that are used together


def look_now(px_per_cell: float, known: PatternFacts) -> RangeLook:
    """Current observation of the chart's size."""
    rail = known.axes.get("z_mm")
    return RangeLook(px_per_cell, known.distance_mm, None if rail is None else rail.at)


def range_facts(look: RangeLook, optics: ImagingGeometry, known: PatternFacts) -> dict[str, Fact]:
    """Facts of this observation; with a laser also its offset from the lens, by this observation and earlier ones.

    With unchanged focus the image distance is F pixels, whatever the distance z: px = F cell / z, and the laser reads
    z + offset. Distances that differ by 5 % give F cell and the offset as slope and intercept of a line; before that
    the lens's data are used, as if it were focused here.
    """
    looks = (*known.looks, look)
    name = f"{LOOKS}{len(looks)}"
    facts: dict[str, Fact] = {f"{LOOKS}looks": float(len(looks)), f"{name}_cell_px": look.px_per_cell}
    if look.rail_mm is not None:
        facts[f"{name}_rail_mm"] = look.rail_mm
    if look.laser_mm is None:
        return facts
    offset = fit_offset_mm([(one.px_per_cell, one.laser_mm) for one in looks if one.laser_mm is not None])
    by_lens = look.laser_mm - optics.distance_mm(look.px_per_cell)
    return facts | {f"{name}_laser_mm": look.laser_mm, "laser_offset_mm": by_lens if offset is None else offset}


def fit_offset_mm(pairs: Sequence[tuple[float, float]]) -> float | None:
    """Offset of laser readings (mm) from the lens, by the pixels per cell; None without two distinct distances."""
    px, laser = np.array(pairs).T
    if np.ptp(px) < MIN_DIFFERENCE * px.mean():
        return None
    _, offset = np.polyfit(1 / px, laser, 1)
    return float(offset)


def range_readings(new_facts: Facts) -> tuple[Reading, ...]:
    """Reading of the laser's offset, where there is a laser."""
    if "laser_offset_mm" not in new_facts:
        return ()
    offset_mm = float(new_facts["laser_offset_mm"])
    return (Reading("laser behind lens", offset_mm, "mm", -LASER_REACH_MM, LASER_REACH_MM),)
