"""Evidence of corruptions in the fit of a textured scene, a chart or a wall: tests, and what they do not exclude."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.corruption.directions import FLOW, GHOST, GHOST_PX, MEDIAN, THRESHOLD, WIDE_NAMES, WIDE_PX
from procedures.corruption.family import FILTERED, GHOSTED, SELECTIVE, Strength, nuisance
from procedures.corruption.noise import MASK_RADII, noise_checks
from procedures.numerics.arrays import Array
from procedures.outcome import Check

MASK_PRIOR, WIDE_PRIOR, GHOST_PRIOR = 0.08, 0.05, 0.05
"""Prior amounts of unsharp masks of 1 pixel and of several in a picture that is no RAW file, and of a ghost."""
PRESENT = 0.5
"""Prior probability that there is a wide mask, or a ghost, at all."""
WIDE_UNSEEN = 0.06
"""Amount of a mask of 3 pixels in pictures whose scene has no frame to show it."""


@dataclass(frozen=True)
class Evidence:
    """Scores of a fit.

    masks : unsharp masks of `MASK_RADII` in the noise
    textured : masks of `SMOOTHING_RADII` where the scene may have a texture, which the lens images
    strengths : by the directions of `procedures.corruption.directions`
    """

    masks: list[Strength]
    textured: list[Strength]
    strengths: Mapping[str, Strength]

    @property
    def fine(self) -> Strength:
        """The mask of one pixel."""
        return self.masks[MASK_RADII.index(1.0)]

    def checks(self, *, raw: bool) -> list[Check]:
        """Tests of the corruptions that every textured scene shows."""
        scores = {name: one.score for name, one in self.strengths.items()}
        return [
            *noise_checks(self.masks, self.textured, raw=raw),
            FILTERED.check(max(scores[MEDIAN], scores[FLOW]), raw=raw, places=2),
            SELECTIVE.check(scores[THRESHOLD], raw=raw),
            GHOSTED.check(scores[GHOST], raw=raw),
        ]

    def modes(self, f: Array, *, raw: bool) -> dict[str, Array]:
        """Relative changes of the transfer function at frequencies f (n,) by one standard deviation of each corruption
        not excluded."""
        modes = {"ghost": _unseen(self.strengths[GHOST], GHOST_PRIOR, PRESENT) * _mask(f, GHOST_PX)}
        if raw:
            return modes
        share = PRESENT / len(WIDE_PX)
        wide = [
            _unseen(self.strengths[name], WIDE_PRIOR, share) * _mask(f, radius)
            for name, radius in zip(WIDE_NAMES, WIDE_PX, strict=True)
            if name in self.strengths
        ]
        return modes | {
            "processing": _unseen(self.fine, MASK_PRIOR) * _mask(f, 1.0),
            "wide mask": np.hypot(*wide) if wide else WIDE_UNSEEN * _mask(f, WIDE_PX[0]),
        }


def _unseen(one: Strength, prior: float, present: float = 1.0) -> float:
    return nuisance(one.unseen, one.uncertainty, prior, present)


def _mask(f: Array, radius_px: float) -> Array:
    """Gain of an unsharp mask of amount 1 at frequencies f, less 1."""
    return np.asarray(1 - np.exp(-2 * (np.pi * f * radius_px) ** 2))
