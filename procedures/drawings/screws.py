"""Screws that hold a sensor, in ASCII, seen from behind the camera."""

import math
from collections.abc import Sequence

DIAL = (5.0, 12.0)  # half height and half width of the circle of screws, in lines and columns
SENSOR = ("+---------+", *3 * ("|         |",), "+---------+")


def screws_drawing(angles_deg: Sequence[float]) -> str:
    """The screws, numbered, at their angles clockwise from the top."""
    rows, columns = (2 * round(half) + 1 for half in DIAL)
    dial = [[" "] * (columns + 2) for _ in range(rows)]
    for i, line in enumerate(SENSOR, (rows - len(SENSOR)) // 2):
        start = (columns - len(line)) // 2
        dial[i][start : start + len(line)] = line
    for number, angle in enumerate(angles_deg, 1):
        row = round(DIAL[0] * (1 - math.cos(math.radians(angle))))
        column = round(DIAL[1] * (1 + math.sin(math.radians(angle))))
        dial[row][column : column + len(str(number))] = str(number)
    return "\n".join("".join(line).rstrip() for line in dial)
