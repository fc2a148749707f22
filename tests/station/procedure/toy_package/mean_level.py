"""The mean level of photographs: a procedure of a package outside, in one file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from procedures.numbers import Group, NumberSection
from procedures.outcome import Check, Outcome, Quantity, Verdict, verdict_of
from procedures.raw import RawFrame
from station.procedure import PhotographProcedure, PlaneSettings, setting

LEVEL = NumberSection("Of a mean level")(
    "mean_level", "1", "Mean level", "mean of the plane, white = 1", Group.HEADLINE, Group.LINE, Group.CERTIFIED
)


class LevelSettings(PlaneSettings, frozen=True, kw_only=True):
    """What can be set."""

    border_px: Annotated[int, setting("Pixels of the rim that are excluded.", least=0, most=100)] = 4


@dataclass(frozen=True)
class Level:
    """The result of a plane."""

    numbers: Mapping[str, Quantity]
    curves: Mapping[str, np.ndarray]


class MeanLevel(PhotographProcedure[LevelSettings]):
    """The mean of a plane, and its profile along the columns."""

    name = "mean-level"
    title = "mean level of a photograph"
    help = "Measure the mean level of IMAGE."
    Settings = LevelSettings

    def run(self, frames: Sequence[RawFrame], settings: LevelSettings) -> Mapping[str, Outcome[Level]]:
        """The level of every plane; a dark photograph is doubtful."""
        return {name: self._level(plane.samples, settings.border_px) for name, plane in frames[0].planes.items()}

    def _level(self, samples: np.ndarray, border: int) -> Outcome[Level]:
        inside = samples[border:-border, border:-border] if border else samples
        mean, spread = float(inside.mean()), float(inside.std() / inside.size**0.5)
        numbers = {LEVEL: Quantity(mean, LEVEL.unit, spread, "mean of all samples", inside.size)}
        curves = {"row": np.arange(len(inside), dtype=float), "level": inside.mean(axis=1)}
        dark = Check(
            "light", mean, 0.05, Verdict.DOUBTFUL, f"the mean level is {mean:.2g}", "expose longer", least=True
        )
        return verdict_of([dark], Level(numbers, curves))
