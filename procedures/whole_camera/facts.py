"""Facts of a session of the whole camera: those of geometry and sensor, the flats, and the turned views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.facts import gathered_numbers
from procedures.geometry.facts import GeometryFacts
from procedures.sensor.facts import SensorFacts

FLAT, TURNED = "flat_", "turned_"
"""Prefixes of a picture's mark: facts of the panel's quarter turns, and of the number of a view of the turned chart."""
PANEL, NO_PANEL = "with a light panel", "without"
PANEL_TURNED = "panel_turned_"  # prefix of a number of quarter turns: the fact that the panel was turned by it


@dataclass(frozen=True)
class WholeCameraFacts(GeometryFacts, SensorFacts):
    """Facts of the plan.

    Attributes
    ----------
    light : `PANEL`, or `NO_PANEL` without sensor and vignetting
    flats : quarter turns of the panel, by the picture's mark
    turned : numbers of the views of the turned chart, by the photograph's mark
    """

    light: str = PANEL
    flats: Mapping[str, float] = gathered_numbers(FLAT)
    turned: Mapping[str, float] = gathered_numbers(TURNED)
