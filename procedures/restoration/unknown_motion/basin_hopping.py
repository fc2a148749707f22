"""Turns of curves that descent cannot leave: other curves of a pool, and bends moved at random.

Each is followed by descent on what the whole frame says of the masks, and kept where that ends lower (basin hopping,
after Wales and Doye 1997). No photograph is touched in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.cross_relation import INSTANTS
from procedures.restoration.unknown_motion.mask_evidence import MaskEvidence, fitted
from procedures.restoration.unknown_motion.motion_splines import POINTS
from procedures.restoration.unknown_motion.path_pairs import PairSettings, distinct, replaced


@dataclass(frozen=True)
class BendSettings:
    """Bends that are tried at random.

    Attributes
    ----------
    number : int
        Of them; each takes a descent.
    moved : float
        Standard deviation of how far one is moved, pixels: as far as curves that draw one mask differ.
    wide : (float, float)
        Least and greatest width, of the exposure.
    """

    number: int = 40
    moved: float = 0.5
    wide: tuple[float, float] = (0.06, 0.25)


@dataclass(frozen=True)
class Turns:
    """What is tried: pools of curves (POINTS, 2) for each photograph, none where curves are recorded, and chance."""

    pools: Sequence[Sequence[Array]]
    rng: np.random.Generator
    bends: BendSettings = field(default_factory=BendSettings)
    pairs: PairSettings = field(default_factory=PairSettings)

    def beside(self, origin: Array) -> Turns:
        """The same about another origin, pixels x, y."""
        return replace(self, pools=[[one - origin for one in pool] for pool in self.pools])

    def fewer(self) -> Turns:
        """For curves that were turned already: those of the pools are worse, and fewer bends find better ones."""
        return replace(self, pools=[], bends=replace(self.bends, number=self.bends.number // 2))

    def taken(self, evidence: Sequence[MaskEvidence], points: Array, half: float) -> Array:
        """The best curves met, (2, POINTS, 2), beginning with `points` of half-width `half`."""
        best = _better((np.inf, points), evidence, points, half)
        flat = [one for one in evidence if one.w == half]
        for k, pool in enumerate(self.pools):
            for one in distinct(flat, best[1], half, k, pool, self.pairs):
                best = _better(best, evidence, replaced(best[1], k, one), half)
        for _ in range(self.bends.number):
            k = int(self.rng.integers(2))
            best = _better(best, evidence, replaced(best[1], k, self._bent(best[1][k])), half)
        return best[1]

    def _bent(self, points: Array) -> Array:
        """A curve (POINTS, 2) with one bend moved, anywhere along it."""
        at, width = self.rng.uniform(-0.1, 1.1), self.rng.uniform(*self.bends.wide)
        bump = np.exp(-(((np.linspace(0, 1, POINTS) - at) / width) ** 2) / 2)
        return np.asarray(points + bump[:, None] * self.rng.normal(0, self.bends.moved, 2))


def _better(
    best: tuple[float, Array], evidence: Sequence[MaskEvidence], points: Array, half: float
) -> tuple[float, Array]:
    """Cost and curves where descent from `points` ends, or the best so far."""
    found = fitted(evidence, points, half, (0, 1), INSTANTS, 15, 1e-3, best[0])
    return min(best, found, key=lambda one: one[0])
