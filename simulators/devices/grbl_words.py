"""GRBL's texts: greetings, settings, identities, and G-code words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

BANNERS = {
    "GRBL": "Grbl 1.1h ['$' for help]",
    "grblHAL": "GrblHAL 1.1f ['$' or '$HELP' for help]",
    "FluidNC": "Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]",
}
_WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")
_ASSIGNMENT = re.compile(r"\$(\d{1,3})=(-?\d+\.?\d*)")
_COMMENT = re.compile(r"\([^)]*\)|;.*")
AXES = set("XYZABC")
FEED_MM_MIN, ACCELERATION_MM_S2 = 3000.0, 200.0


def default_settings(travels: Sequence[float]) -> dict[int, float]:
    """`$n` of a bench with these travels; homing and soft limits on."""
    settings: dict[int, float] = {
        0: 10,
        1: 255,
        10: 1,
        13: 0,
        20: 1,
        21: 0,
        22: 1,
        23: 0,
        24: 300,
        25: 3000,
        27: 1,
        30: 1000,
        32: 0,
    }
    for i, travel in enumerate(travels):
        settings |= {100 + i: 250, 110 + i: FEED_MM_MIN, 120 + i: ACCELERATION_MM_S2, 130 + i: travel}
    return settings


def settings_lines(settings: Mapping[int, float], variant: str) -> list[str]:
    """The answer to `$$`; FluidNC keeps speeds and travels in a file of its own."""
    shown = {n: v for n, v in sorted(settings.items()) if variant != "FluidNC" or n < 100}
    return [f"${number}={value:.3f}" if number >= 24 else f"${number}={value:.0f}" for number, value in shown.items()]


def identity(variant: str, asked: str, rx_bytes: int) -> list[str]:
    """The answer to `$I` or `$I+`; nothing where the firmware does not know the question."""
    if variant == "grblHAL":
        extra = ["[AXS:3:XYZ]", "[NEWOPT:ENUMS,RT+]", "[FIRMWARE:grblHAL]"] if asked == "$I+" else []
        return ["[VER:1.1f.20260817:]", f"[OPT:VNMSL,35,{rx_bytes},3,0]", *extra]
    if asked == "$I+":
        return []
    version = "3.7 FluidNC v3.7.8" if variant == "FluidNC" else "1.1h.20190830"
    return [f"[VER:{version}:]", f"[OPT:V,15,{rx_bytes}]"]


def offsets(work: Sequence[float]) -> list[str]:
    """The answer to `$#`: G54 is the work offset, all others are zero."""
    none = [0.0] * len(work)
    names = ["G55", "G56", "G57", "G58", "G59", "G28", "G30", "G92"]
    lines = [f"[G54:{numbers(work, 1.0)}]", *(f"[{name}:{numbers(none, 1.0)}]" for name in names)]
    return [*lines, "[TLO:0.000]", f"[PRB:{numbers(none, 1.0)}:0]"]


def clean(line: bytes) -> str:
    """A line without comments and spaces, in capitals."""
    text = _COMMENT.sub("", line.decode("ascii", "replace"))
    return "".join(c for c in text if c > " ").upper()


def assignment(line: str) -> tuple[int, float] | None:
    """Number and value of `$n=v`."""
    found = _ASSIGNMENT.fullmatch(line)
    return (int(found[1]), float(found[2])) if found else None


def numbers(values: Sequence[float], scale: float) -> str:
    """Comma-separated with three decimals."""
    return ",".join(f"{value * scale:.3f}" for value in values)


def places(
    settings: Mapping[int, float],
    machine: Sequence[float],
    work: Sequence[float],
    count: int,
    busy: bool,
    override: int = 100,
) -> list[str]:
    """The position of the `count`-th report, with the fields that only some reports carry."""
    scale, mask = 1 / 25.4 if settings[13] == 1 else 1.0, int(settings[10])
    place = machine if mask & 1 else [a - b for a, b in zip(machine, work, strict=True)]
    fields = [("MPos:" if mask & 1 else "WPos:") + numbers(place, scale)]
    if count % (30 if busy else 10) == 1:
        fields.append("WCO:" + numbers(work, scale))
    elif count % (30 if busy else 10) == 2:
        fields.append(f"Ov:{override},100,100")
    return fields


@dataclass(frozen=True)
class Words:
    """One block's words: G and M numbers, values by letter, letters that mean nothing here."""

    gs: frozenset[int]
    ms: frozenset[int]
    values: Mapping[str, float]
    axes: frozenset[str]
    other: frozenset[str]

    def inches(self, before: bool) -> bool:
        """Whether lengths are inches, given the mode before."""
        return 20 in self.gs or (before and 21 not in self.gs)


KNOWN_G = {0, 1, 4, 17, 20, 21, 53, 54, 90, 91, 94}
KNOWN_M = {3, 4, 5, 7, 8, 9}


def read(text: str) -> Words | int:
    """The words of a block, or GRBL's error code."""
    at, gs, ms, values = 0, set[int](), set[int](), dict[str, float]()
    while at < len(text):
        found = _WORD.match(text, at)
        if not found:
            return 2 if text[at].isalpha() else 1
        letter, number, at = found[1], float(found[2]), found.end()
        if letter in "GM":
            if number != int(number) or int(number) not in (KNOWN_G if letter == "G" else KNOWN_M):
                return 20
            (gs if letter == "G" else ms).add(int(number))
        elif letter in values:
            return 25
        else:
            values[letter] = number
    other = frozenset(set(values) - AXES - set("FNPS"))
    if other:
        return 36
    if len(gs & {0, 1}) > 1 or len(gs & {20, 21}) > 1 or len(gs & {90, 91}) > 1:
        return 21
    return Words(
        frozenset(gs), frozenset(ms), values, frozenset(values) & frozenset(AXES), frozenset(values) & {"P", "S"}
    )
