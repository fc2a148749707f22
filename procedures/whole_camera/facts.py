"""What a session of the whole camera knows: what its geometry and its sensor do, and which pictures are flats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.facts import gathered, number
from procedures.geometry.facts import GeometryFacts
from procedures.plan import Facts
from procedures.sensor.facts import SensorFacts

FLAT, TURNED = "flat_", "turned_"
"""Before a picture's mark: the fact by how many quarters the panel was turned; which view of the turned chart it is."""
PANEL, NO_PANEL = "with a light panel", "without"
PANEL_TURNED = "panel_turned_"
"""Before a number of quarter turns: the fact that the panel was turned by so many."""


def flats_of(facts: Facts) -> Mapping[str, float]:
    """Quarter turns of the panel by the mark of the picture. Raises BadParameter."""
    return _numbered(facts, FLAT)


def turned_of(facts: Facts) -> Mapping[str, float]:
    """Numbers of the views of the turned chart by the mark of the photograph. Raises BadParameter."""
    return _numbered(facts, TURNED)


def _numbered(facts: Facts, prefix: str) -> Mapping[str, float]:
    return {name.removeprefix(prefix): number(facts, name) for name in facts if name.startswith(prefix)}


@dataclass(frozen=True)
class WholeCameraFacts(GeometryFacts, SensorFacts):
    """The facts of the plan.

    Attributes
    ----------
    light : `PANEL`, or `NO_PANEL`, where sensor and vignetting are left out
    flats : quarter turns of the panel, by the picture's mark
    turned : numbers of the views that show the turned chart, by the photograph's mark
    """

    light: str = PANEL
    flats: Mapping[str, float] = gathered(flats_of, prefix=FLAT)
    turned: Mapping[str, float] = gathered(turned_of, prefix=TURNED)
