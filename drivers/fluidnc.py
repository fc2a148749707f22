"""Configuration of FluidNC that has no numbered settings, read item by item.

`$/axes/x/max_travel_mm` is answered by `$/axes/x/max_travel_mm=300.000`; an item that does not exist by an error.
Source: FluidNC, Machine/Axis.cpp, Homing.cpp, Motor.cpp, Configuration/RuntimeSetting.cpp.
"""

from __future__ import annotations

from collections.abc import Callable

Ask = Callable[[str], str | None]
"""The value of one item, None if the controller does not have it."""

MACHINE = {1: "stepping/idle_ms", 13: "report_inches"}
AXIS = {100: "steps_per_mm", 110: "max_rate_mm_per_min", 120: "acceleration_mm_per_sec2", 130: "max_travel_mm"}
SHARED = {24: "homing/feed_mm_per_min", 25: "homing/seek_mm_per_min", 27: "motor0/pulloff_mm"}
"""GRBL has one number for what FluidNC has for each axis; the more cautious value is used."""
SWITCHES = {20: "soft_limits", 21: "motor0/hard_limits"}


def items(letters: str) -> list[str]:
    """All items to be read, for the axes of these letters."""
    names = [*AXIS.values(), *SHARED.values(), *SWITCHES.values(), "homing/mpos_mm", "homing/positive_direction"]
    return [*MACHINE.values(), *(f"axes/{letter.lower()}/{item}" for letter in letters for item in names)]


def number(text: str | None) -> float | None:
    """A number, or 1 and 0 for true and false; None for anything else."""
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def read_settings(letters: str, ask: Ask) -> dict[int, float]:
    """GRBL's numbered settings derived from the configuration, for the axes of these letters."""
    settings = {n: value for n, item in MACHINE.items() if (value := number(ask(item))) is not None}
    for at, letter in enumerate(letters):
        for first, item in AXIS.items():
            if (value := number(ask(f"axes/{letter.lower()}/{item}"))) is not None:
                settings[first + at] = value
    for n, item in (SHARED | SWITCHES).items():
        values = [v for letter in letters if (v := number(ask(f"axes/{letter.lower()}/{item}"))) is not None]
        if values:
            settings[n] = max(values) if n in (21, 27) else min(values)
    return settings


def read_spaces(letters: str, ask: Ask) -> dict[int, tuple[float, float]]:
    """Both ends of each axis in machine coordinates, by its index among the letters.

    An axis ends at `mpos_mm` on the side where it homes; an axis that does not home is omitted.
    """
    spaces = {}
    for at, letter in enumerate(letters):
        axis = f"axes/{letter.lower()}"
        end, length = number(ask(f"{axis}/homing/mpos_mm")), number(ask(f"{axis}/max_travel_mm"))
        if end is not None and length is not None:
            up = ask(f"{axis}/homing/positive_direction") != "false"
            spaces[at] = (end - length, end) if up else (end, end + length)
    return spaces
