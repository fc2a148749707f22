"""Screws that hold a sensor, in ASCII, seen from behind the camera: where each is, and how far it is to be turned."""

import math
from collections.abc import Sequence

DIAL = (5.0, 12.0)
"""Half height and half width of the circle of screws, in lines and columns."""
SENSOR = ("+---------+", *3 * ("|         |",), "+---------+")
BAR = 10
"""Columns of a bar for a whole turn."""


def screws_drawing(angles_deg: Sequence[float], turns: Sequence[float] = ()) -> str:
    """The screws, numbered, at their angles clockwise from the top; beside them a bar of each turn, `>` away from the
    lens, `<` towards it."""
    rows, columns = (2 * round(half) + 1 for half in DIAL)
    dial = [[" "] * (columns + 2) for _ in range(rows)]
    for i, line in enumerate(SENSOR, (rows - len(SENSOR)) // 2):
        start = (columns - len(line)) // 2
        dial[i][start : start + len(line)] = line
    for number, angle in enumerate(angles_deg, 1):
        row = round(DIAL[0] * (1 - math.cos(math.radians(angle))))
        column = round(DIAL[1] * (1 + math.sin(math.radians(angle))))
        dial[row][column : column + len(str(number))] = str(number)
    whole = max([1.0, *map(abs, turns)])
    bars = [_bar(number, turn, whole) for number, turn in enumerate(turns, 1)]
    scale = [f"  |0{f'{whole:.3g} turn':>{BAR - 1}}|"] if turns else []
    beside = [*scale, *bars, *[""] * rows]
    return "\n".join(f"{''.join(line)}{extra}".rstrip() for line, extra in zip(dial, beside, strict=False))


def _bar(number: int, turn: float, whole: float) -> str:
    """The way from the present place to the wanted one."""
    filled = round(BAR * abs(turn) / whole)
    head = "=" * max(filled - 1, 0) + (">" if turn > 0 else "<") if filled else ""
    return f"{number:>2}|{head:<{BAR}}| {abs(turn):.2f} {'away' if turn > 0 else 'nearer'}"
