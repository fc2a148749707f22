"""One line of G-code as GRBL 1.1 parses it: the words, the resulting modes, or the error number.

Errors come in the firmware's order: first each word, then their combination. Arcs are
checked and then driven as their chords; probing is not supported.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
_GROUPS = {
    **dict.fromkeys((0, 1, 2, 3, 80), "motion"),
    **dict.fromkeys((17, 18, 19), "plane"),
    **dict.fromkeys((90, 91), "distance"),
    **dict.fromkeys((93, 94), "feed_mode"),
    **dict.fromkeys((20, 21), "units"),
    **dict.fromkeys((54, 55, 56, 57, 58, 59), "system"),
    **dict.fromkeys((4, 10, 28, 30, 53, 92), "non_modal"),
    **dict.fromkeys((43, 49), "length"),
    40: "radius",
    61: "path",
}
_M_GROUPS = {
    **dict.fromkeys((0, 1, 2, 30), "flow"),
    **dict.fromkeys((3, 4, 5), "spindle"),
    **dict.fromkeys((8, 9), "flood"),
}
_FRACTIONS = {(28, 10), (30, 10), (92, 10), (91, 10), (43, 10)}
_TAKES_AXES = {10, 28, 30, 92, 43, 49, 0, 1, 2, 3}
_PLANES = {17: "XY", 18: "XZ", 19: "YZ"}
LINEAR = "XYZ"


@dataclass(frozen=True)
class Modes:
    """Modal state; lengths in mm, initialised as after a reset."""

    motion: int = 0
    system: int = 54
    plane: int = 17
    units: int = 21
    distance: int = 90
    feed_mode: int = 94
    spindle: int = 5
    flood: int = 9
    tool: int = 0
    feed: float = 0.0
    speed: float = 0.0

    @property
    def scale(self) -> float:
        """Millimetres per unit."""
        return 25.4 if self.units == 20 else 1.0


@dataclass(frozen=True)
class Code:
    """A parsed line: modes after it, its non-modal commands, its values in mm, and whether it moves."""

    modes: Modes
    once: float | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    moves: bool = False
    flow: int | None = None
    length: float | None = None

    @property
    def axes(self) -> dict[str, float]:
        return {letter: self.values[letter] for letter in LINEAR if letter in self.values}


@dataclass
class _Words:
    groups: dict[str, float] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    takes_axes: float | None = None

    def take(self, letter: str, value: float) -> int:
        """Record a word; returns its error number, or 0."""
        if letter == "G":
            return self._take_g(int(value), round(100 * (value - int(value))))
        if letter == "M":
            number = int(value)
            if round(100 * (value - int(value))):
                return 23
            return self._group(_M_GROUPS[number], number) if number in _M_GROUPS else 20
        if letter not in "FIJKLNPRSTXYZ":
            return 20
        if letter in self.values:
            return 25
        if letter in "FNPTS" and value < 0:
            return 4
        if letter == "T" and value > 255:
            return 38
        self.values[letter] = value
        return 0

    def _take_g(self, number: int, part: int) -> int:
        if number in _TAKES_AXES and (part == 0 or number in (43, 49)):
            if self.takes_axes is not None:
                return 24
            self.takes_axes = number
        group = _GROUPS.get(number)
        if group is None or (number in (28, 30, 92, 61, 90, 91) and part and (number, part) not in _FRACTIONS):
            return 20
        if number == 43 and part != 10:
            return 20
        if part and (number, part) not in _FRACTIONS:
            return 23
        return self._group("arc_distance" if (number, part) == (91, 10) else group, number + part / 100)

    def _group(self, group: str, number: float) -> int:
        if group in self.groups:
            return 21
        self.groups[group] = number
        return 0


def _split(text: str) -> _Words | int:
    words, at = _Words(), 0
    while at < len(text):
        if not "A" <= text[at] <= "Z":
            return 1
        number = _NUMBER.match(text, at + 1)
        if number is None:
            return 2
        if error := words.take(text[at], float(number[0])):
            return error
        at = number.end()
    return words


def read(text: str, modes: Modes, *, jog: bool = False) -> Code | int:
    """Parse the line in these modes, or return the error number. `jog` parses what follows `$J=`; the modes stay."""
    words = _split(text)
    if isinstance(words, int):
        return words
    groups, values = words.groups, words.values
    names = ("motion", "system", "plane", "units", "distance", "feed_mode", "spindle", "flood")
    selected = {name: int(groups[name]) for name in names if name in groups}
    after = replace(modes, **selected)
    if jog and "motion" not in groups:
        after = replace(after, motion=1, feed_mode=94)
    axes = {letter: values[letter] * after.scale for letter in LINEAR if letter in values}
    takes = words.takes_axes
    if axes and takes is None:
        takes = after.motion
    after, error = _feed(values, after, modes, jog=jog)
    tool_length = 37 if groups.get("length") == 43.1 and set(axes) != {"Z"} else 0
    if error := error or _non_modal(groups.get("non_modal"), groups, values, axes) or tool_length:
        return error
    moves = takes in (0, 1, 2, 3, 80) and bool(axes)
    if error := _motion(groups, values, axes, after, takes):
        return error
    if _unused(groups, values, after if moves else None, jog=jog):
        return 36
    if jog and set(groups) - {"units", "distance", "non_modal"}:
        return 16
    after = replace(after, tool=int(values.get("T", 0)))
    used = {**{k: v for k, v in values.items() if k not in LINEAR}, **axes}
    flow = groups.get("flow")
    return Code(
        after, groups.get("non_modal"), used, moves, None if flow in (None, 1) else int(flow), groups.get("length")
    )


def _feed(values: Mapping[str, float], after: Modes, before: Modes, *, jog: bool) -> tuple[Modes, int]:
    if values.get("N", 0.0) > 10_000_000:
        return after, 27
    if jog and not values.get("F"):
        return after, 22
    if after.feed_mode == 93:
        if after.motion in (1, 2, 3) and "F" not in values and set(values) & set(LINEAR):
            return after, 22
        feed = values.get("F", 0.0)
    elif "F" in values:
        feed = values["F"] * after.scale
    else:
        feed = before.feed if before.feed_mode == 94 else 0.0
    return replace(after, feed=feed, speed=values.get("S", after.speed)), 0


def _non_modal(
    once: float | None, groups: Mapping[str, float], values: Mapping[str, float], axes: Mapping[str, float]
) -> int:
    if once == 4 and "P" not in values:
        return 28
    if once == 10:
        if not axes:
            return 26
        if "P" not in values and "L" not in values:
            return 28
        if values.get("P", 0) > 6:
            return 29
        if values.get("L") not in (2, 20) or (values["L"] == 2 and "R" in values):
            return 20
    if once == 92 and not axes:
        return 26
    return 0


def _motion(
    groups: Mapping[str, float], values: Mapping[str, float], axes: Mapping[str, float], after: Modes,
    takes: float | None,
) -> int:  # fmt: skip
    if groups.get("non_modal") == 53 and after.motion not in (0, 1):
        return 30
    if after.motion == 80:
        return 31 if axes else 0
    if takes not in (1, 2, 3):
        return 0
    if not after.feed:
        return 22
    return _arc(values, axes, after) if takes in (2, 3) else 0


def _arc(values: Mapping[str, float], axes: Mapping[str, float], after: Modes) -> int:
    plane = _PLANES[after.plane]
    if not axes:
        return 26
    if not set(plane) & set(axes):
        return 32
    if "R" in values:
        return 0
    centre = {"X": "I", "Y": "J", "Z": "K"}
    return 0 if any(centre[letter] in values for letter in plane) else 35


def _unused(groups: Mapping[str, float], values: Mapping[str, float], driven: Modes | None, *, jog: bool) -> bool:
    """Whether a value on the line is used by no command."""
    used = set("NF" if jog else "NFST") | set(LINEAR)
    once = groups.get("non_modal")
    used |= set("P") if once == 4 else set("LP") if once == 10 else set()
    if driven is not None and driven.motion in (2, 3):
        used |= set("RIJKP")
    return bool(set(values) - used)
