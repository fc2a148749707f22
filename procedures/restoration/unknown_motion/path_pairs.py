"""Pairs of curves that the surrounding frame contradicts least, among those that a flat part cannot separate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.cross_relation import INSTANTS, Disagreement
from procedures.restoration.unknown_motion.mask_evidence import MaskEvidence, fit_curves, masks_at

PAIRED = 14
"""Curves of each pool that are paired."""
DIFFERENT, LARGER = 0.1, 1.3
"""Relative difference of the masks of distinct curves, at this size relative to the flat part's: other depths separate
them."""


@dataclass(frozen=True)
class PathPair:
    """Two curves (2, POINTS, 2), pixels in the flat part, and their contradiction by the frame."""

    points: Array
    disagreement: float


def distinct(flat: Sequence[MaskEvidence], points: Array, half: float, k: int, pool: Sequence[Array]) -> list[Array]:
    """The distinct curves of a pool that best draw the flat part's masks as curve k, after descent from `points` (2,
    POINTS, 2)."""
    costs = []
    for curve in pool:
        cost, pair = fit_curves(flat, replaced(points, k, curve), half, (k,), INSTANTS, 15, 1e-3)
        costs.append((cost, pair[k]))
    R = int(np.ceil(LARGER * half + 1))
    curves: list[Array] = []
    masks: list[Array] = []
    for _, curve in sorted(costs, key=lambda each: each[0]):
        mask = masks_at(curve[None], half, LARGER * half, R)
        if all(np.linalg.norm(mask - other) > DIFFERENT * np.linalg.norm(mask) for other in masks):
            curves.append(curve)
            masks.append(mask)
    return curves[:PAIRED]


def replaced(points: Array, k: int, curve: Array) -> Array:
    """Both curves, with curve k replaced."""
    pair = points.copy()
    pair[k] = curve
    return pair


class Search:
    """Search of curves that the flat part allows and the frame contradicts least; descents : of a pair with renewed
    evidence."""

    def __init__(self, around: Disagreement, flat: Sequence[MaskEvidence], descents: int = 2) -> None:
        self.around, self.flat, self.descents = around, flat, descents

    def starts(self, curves: Sequence[Sequence[Array]]) -> list[PathPair]:
        """Pairs of one of the distinct curves of each photograph, by the frame's contradiction."""
        spectra = [[self.around.spectra(curve) for curve in those] for those in curves]
        pairs = [
            PathPair(np.stack([curves[0][a], curves[1][b]]), self.around.of(first, second))
            for a, first in enumerate(spectra[0])
            for b, second in enumerate(spectra[1])
        ]
        return sorted(pairs, key=lambda pair: pair.disagreement)

    def descend(self, points: Array) -> PathPair:
        """The best pair of a descent from `points`."""
        met = []
        for _ in range(self.descents):
            evidence = [*self.flat, *self.around.evidence(points)]
            points = fit_curves(evidence, points, self.around.half, (0, 1), INSTANTS, 15, 1e-3)[1]
            met.append(PathPair(points, self.around.of(*(self.around.spectra(curve) for curve in points))))
        return min(met, key=lambda pair: pair.disagreement)

    def best(self, starts: Sequence[Array]) -> list[PathPair]:
        """Results of the descents from starts, (2, POINTS, 2) each, the best first."""
        return sorted((self.descend(curve) for curve in starts), key=lambda curve: curve.disagreement)
