"""Turns of a sensor's screws, followed by the focus of a chart in the frame's middle.

The chart is placed where its image lies on the flank of the focus curve: every screw moves the middle of the sensor by
its own move over their number, and the sharpness there falls or rises with it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import j1

from procedures.field.focus import FREQUENCY
from procedures.plan import Advice, Outline, Points, Reading
from procedures.tilt.plane import Screws

FLANK, FOLLOWED = 2.0, 3.5
"""Depths of focus of the image before the sensor at the start, and the farthest that is followed."""
SHARE, SIGMAS = 0.25, 3.0
"""Tolerance of a turn: a share of it, as the aberrations of the lens are not known, and standard uncertainties."""
REACH, HALF = 0.4, 0.05  # length of the bar of the largest turn, and half its height, in fractions of the frame's


def blur_logarithm(depths: float) -> float:
    """Logarithm of the MTF at `FREQUENCY` some depths of focus from best focus, by the blur circle: as many pixels."""
    x = math.pi * FREQUENCY * max(abs(depths), 1e-6)
    return math.log(2 * j1(x) / x)


def followed_turns(screw: int, turns: tuple[float, ...], change: float, screws: Screws, depth_um: float) -> float:
    """Turns of a screw since the logarithm of the MTF has changed; NaN where it cannot be followed.

    screw : its number, from 1; turns : required ones of all screws, of which those before it are done
    """
    each = 1000 * screws.pitch_mm / len(turns) / depth_um
    start = FLANK + each * sum(turns[: screw - 1])
    if not min(start, start + each * turns[screw - 1]) > 0 or max(start, start + each * turns[screw - 1]) > FOLLOWED:
        return math.nan
    depths = np.linspace(0, FOLLOWED + 1, 400)
    logarithms = np.array([blur_logarithm(float(t)) for t in depths])
    now = float(np.interp(-(blur_logarithm(start) + change), -logarithms, depths))
    return (now - start) / each


def turn_advice(
    screw: int, wanted: float, turned: float | None, largest: float, angle_deg: float, noise: float,
    shape: tuple[int, ...],
) -> Advice:  # fmt: skip
    """Advice on the turn of a screw: a bar to match.

    turned : turns so far, None before the first; noise : standard uncertainty of it; largest : turn of the screws;
    shape : rows and columns
    """
    left = wanted - (turned or 0.0)
    tolerance = SHARE * abs(wanted) + SIGMAS * noise
    outline = Outline(*(bar(turns / largest, shape) for turns in (turned or 0.0, wanted)))
    reading = Reading(
        f"screw {screw}", turned or 0.0, "turns", round(wanted - tolerance, 3), round(wanted + tolerance, 3)
    )
    if turned is not None and reading.good:
        return Advice(True, f"Screw {screw} is turned by about {turned:.2f}.", (reading,), outline=outline)
    hour, way = round(angle_deg / 30) % 12 or 12, "away from" if left > 0 else "towards"
    turn = f"Turn screw {screw}, at {hour} o'clock from behind, by {abs(left):.3f} of a turn"
    say = f"{turn}: the sensor moves {way} the lens."
    return Advice(False, say, (reading,), by_hand={f"screw_{screw}_turns": left}, outline=outline)


def bar(length: float, shape: tuple[int, ...]) -> Points:
    """Corners of a bar from the frame's middle, to the right for turns away from the lens; the longest has length 1."""
    rows, columns = shape
    x, y, half = columns / 2, rows / 2, HALF * rows
    end = x + REACH * columns * length
    return (x, y - half), (end, y - half), (end, y + half), (x, y + half)
