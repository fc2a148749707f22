"""Basin hopping over motion paths: restarts from other curves of a pool and with random bends, to escape local minima.

Each start is followed by descent on the whole frame's evidence of the masks, and accepted where that ends lower (after
Wales and Doye 1997). The photographs themselves are not used meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.cross_relation import INSTANTS
from procedures.restoration.unknown_motion.mask_evidence import MaskEvidence, fit_curves
from procedures.restoration.unknown_motion.motion_splines import POINTS
from procedures.restoration.unknown_motion.path_pairs import PairSettings, distinct, replaced


@dataclass(frozen=True)
class BendSettings:
    """Parameters of the random bends.

    Attributes
    ----------
    number : int
        Their number; each costs a descent.
    moved : float
        Standard deviation of the displacement, pixels: the difference of curves that draw the same mask.
    wide : (float, float)
        Smallest and largest width, as fractions of the exposure.
    """

    number: int = 40
    moved: float = 0.5
    wide: tuple[float, float] = (0.06, 0.25)


@dataclass(frozen=True)
class BasinHopping:
    """Starts to try: pools of curves (POINTS, 2) for each photograph, none for recorded curves, and random bends."""

    pools: Sequence[Sequence[Array]]
    rng: np.random.Generator
    bends: BendSettings = field(default_factory=BendSettings)
    pairs: PairSettings = field(default_factory=PairSettings)

    def about_origin(self, origin: Array) -> BasinHopping:
        """With the curves relative to another origin, pixels x, y."""
        return replace(self, pools=[[one - origin for one in pool] for pool in self.pools])

    def fewer(self) -> BasinHopping:
        """For curves that were optimised already: those of the pools are worse, and fewer bends suffice."""
        return replace(self, pools=[], bends=replace(self.bends, number=self.bends.number // 2))

    def minimise(self, evidence: Sequence[MaskEvidence], points: Array, half: float) -> Array:
        """The best curves, (2, POINTS, 2), starting from `points` of half-width `half`."""
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
        at, width = self.rng.uniform(-0.1, 1.1), self.rng.uniform(*self.bends.wide)
        bump = np.exp(-(((np.linspace(0, 1, POINTS) - at) / width) ** 2) / 2)
        return np.asarray(points + bump[:, None] * self.rng.normal(0, self.bends.moved, 2))


def _better(
    best: tuple[float, Array], evidence: Sequence[MaskEvidence], points: Array, half: float
) -> tuple[float, Array]:
    """Cost and curves after descent from `points`, or the best so far."""
    result = fit_curves(evidence, points, half, (0, 1), INSTANTS, 15, 1e-3, best[0])
    return min(best, result, key=lambda fit: fit[0])
