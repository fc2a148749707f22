"""The far tail of an edge: what a lens throws farther than any region reaches, and what the pupil says about it.

Whatever the aberrations, a pupil's OTF leaves 1 with a slope: -4 / (pi f_c) per cycle/pixel for a clear circle of
cutoff f_c. Its PSF then falls as A / r^3 with A = 1 / (pi^3 f_c), its line spread function as 2 A / d^2, and an edge
approaches its plains as 2 A / d.

Coma throws the light of the pupil's rim to one side of where the edge appears, by g: the approach is a / (d - g),
longer on one side than on the other. To first order that adds a g / d^2, which leans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.quality import Diffraction

Array = npt.NDArray[np.float64]

COLUMN, LEAN = 2, 5
"""Of the plains' numbers, the tail's and its lean's."""
SURE = 1e6
"""Weight of a tail that is sure, over the samples' own."""
LEAST_LEAN, MOST_TAIL = 1e-3, 0.2
"""Expected of a g at least, in the samples' standard deviations times square pixels; a at most, in pixels, that of a
cutoff at a third of a cycle per pixel: more is noise."""
PUPIL_DOUBT = 0.05
"""Relative uncertainty of a tail by the pupil: the plane's band of wavelengths, vignetting, the iris's corners."""


@dataclass(frozen=True)
class Tail:
    """What is known of the approach a/d to the plains: a, and its standard uncertainty, in pixels; 0 where it is sure.

    It is weighed against what the plains show by themselves.
    """

    px: float
    uncertainty_px: float = 0.0

    @classmethod
    def of_pupil(cls, diffraction: Diffraction) -> Tail:
        """Of a clear circular pupil, in pixels of the plane."""
        px = 2 / (np.pi**3 * diffraction.cutoff)
        return cls(px, PUPIL_DOUBT * px)

    def contradiction(self, seen: Tail) -> float:
        """How far what is seen lies from what is known, over what is allowed: four uncertainties and three tenths."""
        return abs(seen.px - self.px) / max(4 * math.hypot(self.uncertainty_px, seen.uncertainty_px), 0.3 * self.px)

    def weight(self, variance: float, seen: float) -> float:
        """Of a row that says what is known, among samples of this variance over the squared contrast, and weight 1.

        `seen` is the weight that the samples themselves give the tail.
        """
        known = self.uncertainty_px**2
        return SURE * seen if known * SURE * seen <= variance else variance / known


def with_tail(
    normal: Array, right: Array, tail: Tail | None, weight: float, contrast: float, errors: Array | float = 0.0
) -> tuple[Array, Array]:
    """Normal equations (..., 6, 6), (..., 6) of the plains with a row for what is known of the tail.

    `contrast` is bright less dark; `errors` displaces the row by so many of its uncertainties.
    """
    if tail is None:
        return normal, right
    normal, right = normal.copy(), right.copy()
    normal[..., COLUMN, COLUMN] += weight
    right[..., COLUMN] += weight * contrast * (tail.px + errors * tail.uncertainty_px)
    return normal, right


@dataclass(frozen=True)
class Lean:
    """What is known of a g before: that it lies about 0, within the tail times the edge's width.

    `expected` is that, in samples of the plane times square pixels; `weight` that of a row that says so among samples
    of weight 1.
    """

    expected: float = 0.0
    weight: float = 0.0

    @classmethod
    def of(cls, tail: float, contrast: float, width_px: float, variance: float) -> Lean:
        """Of an approach tail / d between plains of this contrast, in samples of the plane of that variance."""
        expected = max(min(abs(tail), MOST_TAIL * abs(contrast)) * width_px, LEAST_LEAN * math.sqrt(variance))
        return cls(expected, variance / expected**2)

    def added(self, normal: Array, right: Array, errors: Array | float = 0.0) -> tuple[Array, Array]:
        """Normal equations (..., 6, 6), (..., 6) with that row, displaced by `errors` of what is expected."""
        normal, right = normal.copy(), right.copy()
        normal[..., LEAN, LEAN] += self.weight
        right[..., LEAN] += self.weight * self.expected * errors
        return normal, right
