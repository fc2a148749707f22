"""Basin hopping over motion paths: restarts from other curves of a pool and with random bends, to escape local minima.

Each start is followed by descent on the whole frame's evidence of the masks, and accepted where that ends lower (after
Wales and Doye 1997). The photographs themselves are not used meanwhile.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.cross_relation import INSTANTS
from procedures.restoration.unknown_motion.mask_evidence import MaskEvidence, fit_curves
from procedures.restoration.unknown_motion.motion_splines import POINTS
from procedures.restoration.unknown_motion.path_pairs import replaced

BEND_PX = 0.5
"""Standard deviation of a bend's displacement: the difference of curves that draw the same mask."""
BEND_WIDTHS = (0.06, 0.25)
"""Smallest and largest width of a bend, as fractions of the exposure."""


@dataclass(frozen=True)
class BasinHopping:
    """Starts to try: distinct curves (POINTS, 2) by photograph, none for recorded ones, and `bends` random bends, a
    descent each."""

    curves: Sequence[Sequence[Array]]
    rng: np.random.Generator
    bends: int = 40

    def about_origin(self, origin: Array) -> "BasinHopping":
        """With the curves relative to another origin, pixels x, y."""
        return replace(self, curves=[[curve - origin for curve in those] for those in self.curves])

    def fewer(self) -> "BasinHopping":
        """For curves that were optimised already: the others are worse, and fewer bends suffice."""
        return replace(self, curves=[], bends=self.bends // 2)

    def minimise(self, evidence: Sequence[MaskEvidence], points: Array, half: float) -> Array:
        """The best curves, (2, POINTS, 2), starting from `points` of half-width `half`."""
        best = _better((np.inf, points), evidence, points, half)
        for k, those in enumerate(self.curves):
            for curve in those:
                best = _better(best, evidence, replaced(best[1], k, curve), half)
        for _ in range(self.bends):
            k, at, width = int(self.rng.integers(2)), self.rng.uniform(-0.1, 1.1), self.rng.uniform(*BEND_WIDTHS)
            bump = np.exp(-(((np.linspace(0, 1, POINTS) - at) / width) ** 2) / 2)
            bent = best[1][k] + bump[:, None] * self.rng.normal(0, BEND_PX, 2)
            best = _better(best, evidence, replaced(best[1], k, bent), half)
        return best[1]


def _better(
    best: tuple[float, Array], evidence: Sequence[MaskEvidence], points: Array, half: float
) -> tuple[float, Array]:
    """Cost and curves after descent from `points`, or the best so far."""
    result = fit_curves(evidence, points, half, (0, 1), INSTANTS, 15, 1e-3, best[0])
    return min(best, result, key=lambda fit: fit[0])
