"""Axes and places on them, as people write them: `z_mm` is z, its 620 are 620.0 mm."""

from __future__ import annotations


def label(axis: str) -> str:
    """An axis without its unit: "z" of "z_mm"."""
    return axis.rpartition("_")[0] or axis


def in_words(axis: str, place: float, digits: int = 1) -> str:
    """A place on an axis: "620.0 mm", "1.25°": an angle has one digit more where it has any."""
    unit = axis.rpartition("_")[2]
    return f"{place:z.{digits + bool(digits)}f}°" if unit == "deg" else f"{place:z.{digits}f} {unit}"


def way_in_words(axis: str, begin: float, end: float) -> str:
    """From place to place: "z 781.6 to 750.0 mm", "pan -29.70 to 0.00°"."""
    return f"{label(axis)} {in_words(axis, begin).rstrip('°').partition(' ')[0]} to {in_words(axis, end)}"
