"""Far tail of an edge: light scattered farther than any region reaches, and its prediction from the pupil.

Whatever the aberrations, a pupil's OTF leaves 1 with a slope: -4 / (pi f_c) per cycle/pixel for a clear circle of
cutoff f_c. Its PSF then falls as A / r^3 with A = 1 / (pi^3 f_c), its line spread function as 2 A / d^2, and an edge
approaches its plains as 2 A / d.

Coma displaces the light of the pupil's rim by g: the approach is a / (d - g), longer on one side than on the other. To
first order this adds the asymmetry a g / d^2.
"""

import math
from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.quality import Diffraction

COLUMN, LEAN = 2, 5  # indices of the tail and its asymmetry among the plains' parameters
EXACT = 1e6  # weight of an exact prior of the tail, over that of the samples
MIN_LEAN, MAX_TAIL = 1e-3, 0.2
"""Least standard deviation of a g, in the samples' standard deviations times square pixels; greatest a, in pixels, that
of a cutoff of a third of a cycle per pixel."""
PUPIL_UNCERTAINTY = 0.05
"""Relative uncertainty of the pupil's tail: the plane's band of wavelengths, vignetting, the iris's corners."""


@dataclass(frozen=True)
class Tail:
    """Approach a/d to the plains: a and its standard uncertainty, in pixels; an uncertainty of 0 is exact."""

    px: float
    uncertainty_px: float = 0.0

    @classmethod
    def of_pupil(cls, diffraction: Diffraction) -> "Tail":
        """Tail of a clear circular pupil, in pixels of the plane."""
        px = 2 / (np.pi**3 * diffraction.cutoff)
        return cls(px, PUPIL_UNCERTAINTY * px)

    def contradiction(self, estimate: "Tail") -> float:
        """Deviation of an estimate from this prior, over four uncertainties or three tenths, whichever is larger."""
        allowed = max(4 * math.hypot(self.uncertainty_px, estimate.uncertainty_px), 0.3 * self.px)
        return abs(estimate.px - self.px) / allowed

    def weight(self, variance: float, samples: float) -> float:
        """Weight as a prior among samples of weight 1 and this variance over the squared contrast; `samples` : theirs
        of the tail."""
        prior = self.uncertainty_px**2
        return EXACT * samples if prior * EXACT * samples <= variance else variance / prior


def with_tail(
    normal: Array, right: Array, tail: Tail | None, weight: float, contrast: float, errors: Array | float = 0.0
) -> tuple[Array, Array]:
    """Normal equations of the plains with the tail's prior, displaced by `errors` of its uncertainty; contrast : bright
    less dark."""
    if tail is None:
        return normal, right
    normal, right = normal.copy(), right.copy()
    normal[..., COLUMN, COLUMN] += weight
    right[..., COLUMN] += weight * contrast * (tail.px + errors * tail.uncertainty_px)
    return normal, right


@dataclass(frozen=True)
class Lean:
    """Prior of the asymmetry a g: zero mean, the tail times the edge's width as the standard deviation.

    `expected` is that deviation, in samples of the plane times square pixels; `weight` its weight among samples of 1.
    """

    expected: float = 0.0
    weight: float = 0.0

    @classmethod
    def of(cls, tail: float, contrast: float, width_px: float, variance: float) -> "Lean":
        """Prior for an approach tail / d between plains of this contrast, in samples of this variance."""
        expected = max(min(abs(tail), MAX_TAIL * abs(contrast)) * width_px, MIN_LEAN * math.sqrt(variance))
        return cls(expected, variance / expected**2)

    def added(self, normal: Array, right: Array, errors: Array | float = 0.0) -> tuple[Array, Array]:
        """Normal equations (..., 6, 6), (..., 6) with this prior, displaced by `errors` times `expected`."""
        normal, right = normal.copy(), right.copy()
        normal[..., LEAN, LEAN] += self.weight
        right[..., LEAN] += self.weight * self.expected * errors
        return normal, right
