"""Evidence of corruptions in the far photograph of a pair: scores by its residual."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.corruption import directions
from procedures.corruption.directions import BORDER, FLOW, GHOST, GHOST_PX, MEDIAN, THRESHOLD
from procedures.corruption.family import (
    FILTERED,
    GHOSTED,
    SELECTIVE,
    SampleGroup,
    Strength,
    nuisance,
    strengths,
)
from procedures.corruption.noise import (
    DRIFT,
    MASK_RADII,
    SMOOTHING_RADII,
    TEXTURES,
    MaskScore,
    Variogram,
    mask_scores,
    noise_checks,
    texture_correlation,
)
from procedures.outcome import SYMPTOM, Check
from procedures.two_photo.inter_image import PairFit, linear_system, tiles_of

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

MASK_PRIOR, WIDE_PRIOR, WIDE_PX = 0.08, 0.06, 3.0
"""Prior amounts of unsharp masks of 1 and 3 pixels in pictures that are no RAW files; no frame shows the wider one."""
GHOST_PRIOR, GHOST_PRESENT = 0.05, 0.5
"""Prior share of a ghost, and the probability that there is one."""
CONTRAST = 4.0
"""Standard deviations of a wall's light that count as the contrast of black and white."""


@dataclass(frozen=True)
class PairEvidence:
    """Scores of a pair, as those of a chart: masks and textures in the residual, strengths by directions."""

    masks: list[MaskScore]
    textured: list[MaskScore]
    strengths: Mapping[str, Strength]

    def checks(self, *, raw: bool) -> list[Check]:
        """Tests of the corruptions; what the pair shows by itself names the cause better."""
        scores = {name: one.score for name, one in self.strengths.items()}
        checks = [
            *noise_checks(self.masks, self.textured, raw=raw),
            FILTERED.check(max(scores[MEDIAN], scores[FLOW]), raw=raw, places=2),
            SELECTIVE.check(scores[THRESHOLD], raw=raw),
            GHOSTED.check(scores[GHOST], raw=raw),
        ]
        return [replace(one, prior=SYMPTOM * one.prior) for one in checks]

    def modes(self, f: Array, *, raw: bool) -> dict[str, Array]:
        """Relative changes of the transfer function at frequencies f (n,) by what is not excluded."""
        square, ghost = 2 * (np.pi * f) ** 2, self.strengths[GHOST]
        amount = nuisance(ghost.unseen, ghost.uncertainty, GHOST_PRIOR, GHOST_PRESENT)
        modes = {"ghost": amount * (1 - np.exp(-square * GHOST_PX**2))}
        if raw:
            return modes
        fine = self.masks[MASK_RADII.index(1.0)]
        return modes | {
            "processing": nuisance(fine.unseen, fine.uncertainty, MASK_PRIOR) * (1 - np.exp(-square)),
            "wide mask": WIDE_PRIOR * (1 - np.exp(-square * WIDE_PX**2)),
        }


def examine(fit: PairFit, far: Array32, curve: tuple[Array, Array]) -> PairEvidence:
    """Scores of a fit; `curve` are frequencies and MTF."""
    image = fit.as_image(fit.residual, np.nan)
    residual = Variogram.of(np.nan_to_num(image), np.isfinite(image))
    textures = [texture_correlation(*curve, exponent) for exponent in TEXTURES]
    return PairEvidence(
        mask_scores([residual], MASK_RADII),
        mask_scores([residual], SMOOTHING_RADII, [DRIFT, *textures]),
        _strengths(fit, far),
    )


def _strengths(fit: PairFit, far: Array32) -> dict[str, Strength]:
    (x, y), (rows, columns) = fit.near.corner, fit.near.shape
    middle, scale = float(np.mean(fit.samples.y)), CONTRAST * float(np.std(fit.samples.y))
    picture = np.array(far[y : y + rows, x : x + columns], dtype=np.float64)
    at = fit.samples.rows, fit.samples.columns
    picture[at] = fit.prediction
    pictures = directions.filters(np.pad((picture - middle) / scale, BORDER, mode="edge"))
    values = [one[BORDER:-BORDER, BORDER:-BORDER][at] for one in pictures.values()]
    ghost = directions.mirrored(far, (x, y), (rows, columns))
    values.append((ghost[at] - middle) / scale)
    shared, own = linear_system(fit)
    group = SampleGroup(shared, own, fit.residual / scale, tiles_of(fit))
    # the Gram matrix of the last step has the priors of the tail
    amounts = strengths([group], [np.stack(values, axis=1)], fit.equations.G, fit.variance**0.5 / scale)
    return dict(zip([*pictures, GHOST], amounts, strict=True))
