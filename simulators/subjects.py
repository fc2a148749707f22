"""What else than the chart a simulated bench may stand before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from simulators.sheets import Sheet, leaves

WALL_MM = (640.0, 480.0)
WALL_TEXEL_MM = 0.16
LARGEST_MM = 40.0
"""Radius of the wall's largest leaves; the smallest are below a pixel from the near end of the rail."""


@dataclass(frozen=True)
class Subject:
    """Sheets from the back to the front; none: the chart."""

    sheets: tuple[Sheet, ...] = ()


def wall(rng: np.random.Generator) -> Subject:
    """A flat wall with detail of all sizes, wider than the camera sees from the far end of the rail."""
    columns, rows = (round(size / WALL_TEXEL_MM) for size in WALL_MM)
    picture = leaves((rows, columns), rng, largest=LARGEST_MM / WALL_TEXEL_MM)
    return Subject((Sheet(picture, WALL_TEXEL_MM),))


SUBJECTS: Mapping[str, Callable[[np.random.Generator], Subject]] = {"chart": lambda rng: Subject(), "wall": wall}
"""By the name that plans call them."""
