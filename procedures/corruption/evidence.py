"""Evidence of corruptions in the fit of a textured scene, a chart or a wall: tests, and what they do not exclude."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.corruption.directions import (
    ADAPTIVE,
    FLOW,
    GHOST,
    GHOST_PX,
    MEDIAN,
    THRESHOLD,
    VEIL,
    WIDE_NAMES,
    WIDE_PX,
    mask_gain,
)
from procedures.corruption.family import (
    ADAPTED,
    FILTERED,
    GHOSTED,
    MOSAIC,
    SELECTIVE,
    VEILED,
    WIDE,
    Strength,
    nuisance,
)
from procedures.corruption.noise import CONTRASTS, MASK_RADII, noise_checks
from procedures.numerics.arrays import Array
from procedures.outcome import Check

MASK_PRIOR, WIDE_PRIOR, GHOST_PRIOR = 0.08, 0.12, 0.05
"""Prior amounts of unsharp masks of 1 pixel and of several in a picture that is no RAW file, and of a ghost. With 0.05
for several, in every fourth chart, two of 26 charts with 20 % of 3 pixels passed beyond three uncertainties."""
PRESENT = 0.5
"""Prior probability that there is each mask, or a ghost, at all."""
WIDE_MODEL, TEXTURED_MODEL = 0.01, 0.02
"""Standard uncertainty of the amount of a wide mask by the lens's own spread function beyond the core, in its test, and
in the budget where no frame shows the mask."""
ADAPTIVE_PRIOR, ADAPTIVE_MODEL = 1.0, 0.4
"""Prior amount of adaptive smoothing in a picture that is no RAW file; its standard uncertainty, in the test, by faint
detail of a real wall that differs between both photographs: the published pair seems smoothed by 1.0."""


@dataclass(frozen=True)
class TextureEvidence:
    """Scores of a fit.

    masks : unsharp masks of `MASK_RADII` in the noise
    textured : masks of `SMOOTHING_RADII` where the scene may have a texture, which the lens images
    strengths : by the directions of `procedures.corruption.directions`
    mosaic : largest score of unlike noise at the sites of a mosaic
    framed : whether edges of full contrast, in a frame, show wide masks; texture alone is less sure
    smoothing : relative change of the transfer function by adaptive smoothing of amount 1, at the frequencies of the
        modes, where its strength is given
    """

    masks: list[Strength]
    textured: list[Strength]
    strengths: Mapping[str, Strength]
    framed: bool = True
    mosaic: float = 0.0
    smoothing: Array | None = None

    @property
    def fine(self) -> Strength:
        """The mask of one pixel."""
        return self.masks[MASK_RADII.index(1.0)]

    def checks(self, *, raw: bool) -> list[Check]:
        """Tests of the corruptions that every textured scene shows."""
        scores = {name: strength.score for name, strength in self.strengths.items()}
        return [
            *noise_checks(self.masks, self.textured, raw=raw),
            FILTERED.check(max(scores[MEDIAN], scores[FLOW]), raw=raw, places=2),
            SELECTIVE.check(scores[THRESHOLD], raw=raw),
            *([] if raw else self._of_pictures()),
            GHOSTED.check(scores[GHOST], raw=raw),
            VEILED.check(scores[VEIL], raw=raw),
        ]

    def _of_pictures(self) -> list[Check]:
        wide = max(_wide_score(self.strengths[name]) for name in WIDE_NAMES)
        places = 2 * len(CONTRASTS)  # in the noise of paper and residual
        return [
            WIDE.check(wide, raw=False, places=len(WIDE_PX)),
            MOSAIC.check(self.mosaic, raw=False, places=places),
            *([] if self.smoothing is None else [ADAPTED.check(_by_scene(self.strengths[ADAPTIVE]).score, raw=False)]),
        ]

    def modes(self, f: Array, *, raw: bool) -> dict[str, Array]:
        """Relative changes of the transfer function at frequencies f (n,) by one standard deviation of each corruption
        not excluded."""
        modes = {"ghost": _unseen(self.strengths[GHOST], GHOST_PRIOR) * mask_gain(f, GHOST_PX)}
        if raw:
            return modes
        model = 0.0 if self.framed else TEXTURED_MODEL
        wide = [
            _wide(self.strengths[name], model) * mask_gain(f, radius)
            for name, radius in zip(WIDE_NAMES, WIDE_PX, strict=True)
        ]
        processing = _unseen(self.fine, MASK_PRIOR) * mask_gain(f, 1.0)
        if self.smoothing is not None:
            amount = self.strengths[ADAPTIVE]
            smoothed = nuisance(_by_scene(amount).unseen, amount.uncertainty, ADAPTIVE_PRIOR, PRESENT)
            processing = np.hypot(processing, smoothed * self.smoothing)
        return modes | {"processing": processing, "wide mask": np.hypot(*wide)}


def _wide_score(amount: Strength) -> float:
    return amount.value / math.hypot(amount.uncertainty, WIDE_MODEL)


def _by_scene(amount: Strength) -> Strength:
    return Strength(amount.value, math.hypot(amount.uncertainty, ADAPTIVE_MODEL))


def _unseen(strength: Strength, prior: float) -> float:
    return nuisance(strength.unseen, strength.uncertainty, prior, PRESENT)


def _wide(amount: Strength, model: float) -> float:
    """Amount of a wide mask not excluded; an estimate below 0 shows an error of the model as large."""
    unseen = Strength(amount.value, math.hypot(amount.uncertainty, WIDE_MODEL)).unseen
    return nuisance(unseen, math.hypot(amount.uncertainty, model, min(amount.value, 0.0)), WIDE_PRIOR, PRESENT)
