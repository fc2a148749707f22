"""The curves among those a flat part cannot tell apart that other depths agree with: descent, and walks between minima.

Wrong turns, which descent cannot leave, are left by moving a bend at random, pulling the curve back to those that draw
the flat part's masks, and descending anew (basin hopping, after Wales and Doye 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.restoration.disagreement import INSTANTS, Disagreement
from procedures.restoration.forward import Array
from procedures.restoration.mask_evidence import MaskEvidence, fitted, masks_at
from procedures.restoration.paths import POINTS

# of each pool so many curves are paired, and so many of the pairs descend
PAIRED, DESCENDING = 14, 20
# descents between two looks at how far a pair has come
DESCENTS = 2
# so many pairs walk on, by so many steps each
WALKING, STEPS = 6, 8
# a bend is moved by so many pixels, and is so wide, of the exposure
MOVED, WIDE = 0.5, (0.06, 0.25)
# share of their norm by which curves' masks differ that are two, at what size of the flat part's
DIFFERENT, LARGER = 0.1, 1.3


@dataclass(frozen=True)
class Pair:
    """Two curves (2, POINTS, 2), pixels in the flat part, and how much the frame contradicts them."""

    points: Array
    disagreement: float


class Search:
    """Curves that the flat part allows and the frame around contradicts least; flat : what it says of its masks."""

    def __init__(self, around: Disagreement, flat: Sequence[MaskEvidence], rng: np.random.Generator) -> None:
        self.around, self.flat, self.rng = around, flat, rng

    def begun(self, points: Array, pools: Sequence[Sequence[Array]]) -> list[Pair]:
        """Pairs of one curve of each pool that the frame contradicts least, the flat part's `points` in their place."""
        curves = [self._distinct(points, k, pool) for k, pool in enumerate(pools)]
        seen = [[self.around.seen(one) for one in those] for those in curves]
        pairs = [
            Pair(np.stack([curves[0][a], curves[1][b]]), self.around.of(first, second))
            for a, first in enumerate(seen[0])
            for b, second in enumerate(seen[1])
        ]
        return sorted(pairs, key=lambda pair: pair.disagreement)[:DESCENDING]

    def _distinct(self, points: Array, k: int, pool: Sequence[Array]) -> list[Array]:
        """The curves of a pool that draw the flat part's masks best, pulled there, none like another."""
        found = []
        for one in pool:
            pair = points.copy()
            pair[k] = one
            cost, pair = fitted(self.flat, pair, self.around.half, (k,), INSTANTS)
            found.append((cost, pair[k]))
        curves: list[Array] = []
        drawn: list[Array] = []
        for _, one in sorted(found, key=lambda each: each[0]):
            mask = masks_at(one[None], self.around.half, LARGER * self.around.half, self.around.R)
            if all(np.linalg.norm(mask - other) > DIFFERENT * np.linalg.norm(mask) for other in drawn):
                curves.append(one)
                drawn.append(mask)
        return curves[:PAIRED]

    def descended(self, points: Array) -> Pair:
        """The best pair met in descending from `points`."""
        met = []
        for _ in range(DESCENTS):
            evidence = [*self.flat, *self.around.evidence(points)]
            points = fitted(evidence, points, self.around.half, (0, 1), INSTANTS, 15, 1e-3)[1]
            met.append(Pair(points, self.around.of(*(self.around.seen(one) for one in points))))
        return min(met, key=lambda pair: pair.disagreement)

    def walked(self, pair: Pair, steps: int) -> Pair:
        """The best pair met in walking from minimum to minimum."""
        for _ in range(steps):
            k = int(self.rng.integers(2))
            bent = pair.points.copy()
            bent[k] = self._bent(bent[k])
            bent = fitted(self.flat, bent, self.around.half, (k,), INSTANTS, 15, 1e-3)[1]
            pair = min(pair, self.descended(bent), key=lambda one: one.disagreement)
        return pair

    def _bent(self, points: Array) -> Array:
        """A curve (POINTS, 2) with one bend moved, anywhere along it."""
        at, width = self.rng.uniform(-0.1, 1.1), self.rng.uniform(*WIDE)
        bump = np.exp(-(((np.linspace(0, 1, POINTS) - at) / width) ** 2) / 2)
        return np.asarray(points + bump[:, None] * self.rng.normal(0, MOVED, 2))

    def best(self, beginnings: Sequence[Array]) -> list[Pair]:
        """Where the walks from the best of all beginnings, (2, POINTS, 2) each, end."""
        pairs = sorted((self.descended(one) for one in beginnings), key=lambda one: one.disagreement)
        return [self.walked(one, STEPS) for one in pairs[:WALKING]]
