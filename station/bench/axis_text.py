"""Axes and positions as text: `z_mm` is z, its 620 are 620.0 mm; apart from the devices, whose drivers load NumPy."""

from collections.abc import Mapping


def label(axis: str) -> str:
    """An axis without its unit: "z" of "z_mm"."""
    return axis.rpartition("_")[0] or axis


def axis_words(axis: str) -> str:
    """An axis with its unit: "z in mm", "focus in steps"."""
    unit = axis.rpartition("_")[2]
    return f"{label(axis)} in {'°' if unit == 'deg' else unit}"


def position_text(axis: str, place: float, digits: int = 1) -> str:
    """A position on an axis: "620.0 mm", "1.25°"; angles have one decimal more."""
    unit = axis.rpartition("_")[2]
    return f"{place:z.{digits + bool(digits)}f}°" if unit == "deg" else f"{place:z.{digits}f} {unit}"


def moves_text(places: Mapping[str, float], here: Mapping[str, float] | None = None) -> str:
    """Moves to positions, from known ones where given: "z from 781.6 to 750.0 mm, pan to 0.00°"."""
    begin = {axis: f" from {position_text(axis, at).partition(' ')[0]}" for axis, at in (here or {}).items()}
    return ", ".join(f"{label(axis)}{begin.get(axis, '')} to {position_text(axis, at)}" for axis, at in places.items())


def move_text(axis: str, begin: float, end: float) -> str:
    """A move between two positions: "z 781.6 to 750.0 mm", "pan -29.70 to 0.00°"."""
    return f"{label(axis)} {position_text(axis, begin).rstrip('°').partition(' ')[0]} to {position_text(axis, end)}"
