"""Pairs of curves, among all that a flat part cannot tell apart, that the frame around contradicts least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.cross_relation import INSTANTS, Disagreement
from procedures.restoration.unknown_motion.mask_evidence import MaskEvidence, fitted, masks_at


@dataclass(frozen=True)
class PairSettings:
    """How many curves and pairs are looked at, and which are one.

    Attributes
    ----------
    paired, descending : int
        Curves of each pool that are paired, and pairs that descend, those that the frame contradicts least; each costs
        time.
    descents : int
        Of a pair, the evidence taken anew for each, of which the best is kept.
    different, larger : float
        Share of their norm by which curves' masks differ that are two, at this size over the flat part's: other depths
        are what tells them apart.
    """

    paired: int = 14
    descending: int = 16
    descents: int = 2
    different: float = 0.1
    larger: float = 1.3


@dataclass(frozen=True)
class PathPair:
    """Two curves (2, POINTS, 2), pixels in the flat part, and how much the frame contradicts them."""

    points: Array
    disagreement: float


def distinct(
    flat: Sequence[MaskEvidence], points: Array, half: float, k: int, pool: Sequence[Array], s: PairSettings
) -> list[Array]:
    """The curves of a pool that draw the flat part's masks best as curve k, pulled there, none like another.

    flat : what the flat part says of its masks; points : (2, POINTS, 2), of half-width `half`.
    """
    found = []
    for one in pool:
        cost, pair = fitted(flat, replaced(points, k, one), half, (k,), INSTANTS, 15, 1e-3)
        found.append((cost, pair[k]))
    R = int(np.ceil(s.larger * half + 1))
    curves: list[Array] = []
    drawn: list[Array] = []
    for _, one in sorted(found, key=lambda each: each[0]):
        mask = masks_at(one[None], half, s.larger * half, R)
        if all(np.linalg.norm(mask - other) > s.different * np.linalg.norm(mask) for other in drawn):
            curves.append(one)
            drawn.append(mask)
    return curves[: s.paired]


def replaced(points: Array, k: int, one: Array) -> Array:
    """Both curves, curve k another."""
    pair = points.copy()
    pair[k] = one
    return pair


class Search:
    """Curves that the flat part allows and the frame around contradicts least; flat : what it says of its masks."""

    def __init__(
        self, around: Disagreement, flat: Sequence[MaskEvidence], settings: PairSettings | None = None
    ) -> None:
        self.around, self.flat, self.settings = around, flat, settings or PairSettings()

    def begun(self, points: Array, pools: Sequence[Sequence[Array]]) -> list[PathPair]:
        """Pairs of one curve of each pool that the frame contradicts least, the flat part's `points` in their place."""
        s, half = self.settings, self.around.half
        curves = [distinct(self.flat, points, half, k, pool, s) for k, pool in enumerate(pools)]
        seen = [[self.around.seen(one) for one in those] for those in curves]
        pairs = [
            PathPair(np.stack([curves[0][a], curves[1][b]]), self.around.of(first, second))
            for a, first in enumerate(seen[0])
            for b, second in enumerate(seen[1])
        ]
        return sorted(pairs, key=lambda pair: pair.disagreement)[: s.descending]

    def descended(self, points: Array) -> PathPair:
        """The best pair met in descending from `points`."""
        met = []
        for _ in range(self.settings.descents):
            evidence = [*self.flat, *self.around.evidence(points)]
            points = fitted(evidence, points, self.around.half, (0, 1), INSTANTS, 15, 1e-3)[1]
            met.append(PathPair(points, self.around.of(*(self.around.seen(one) for one in points))))
        return min(met, key=lambda pair: pair.disagreement)

    def best(self, beginnings: Sequence[Array]) -> list[PathPair]:
        """Where the descents from beginnings, (2, POINTS, 2) each, end, the best first."""
        return sorted((self.descended(one) for one in beginnings), key=lambda one: one.disagreement)
