"""Several shots of one chart become one PSF: the mean weighted by their covariances, and whether they agree.

A shot's PSF has sum 1, so that its covariance knows nothing of the direction in which all samples grow alike. With Q
an orthonormal basis of the other directions, a_i = Q' h_i and A_i = Q' C_i Q,

    a = (sum A_i^-1)^-1 sum A_i^-1 a_i,   C = Q (sum A_i^-1)^-1 Q',   chi^2 = sum (a_i - a)' A_i^-1 (a_i - a),

with (n - 1)(k^2 - 1) degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from procedures.outcome import Outcome, Rule, Verdict, verdict_of
from procedures.pattern_psf.estimate import PatternPsf
from procedures.psf import Psf
from procedures.quality import Quality, assess

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CombinedPsf:
    """One plane's PSF from several shots.

    Attributes
    ----------
    psf : Psf
    shots : tuple of PatternPsf
        What each shot gave, in their order.
    chi_square : float
        Of the shots about their mean, per degree of freedom: near 1 where they agree within their uncertainties.
    spread : float
        Largest distance of a shot's PSF from the mean, over the norm of the mean.
    """

    psf: Psf
    shots: tuple[PatternPsf, ...]
    chi_square: float
    spread: float

    @property
    def best(self) -> PatternPsf:
        """The shot of the least residual: its picture stands for all."""
        return min(self.shots, key=lambda shot: shot.residual_std)

    @cached_property
    def quality(self) -> Quality:
        """MTF and the numbers drawn from the mean."""
        return assess(self.psf, n=sum(shot.n for shot in self.shots), diffraction=self.shots[0].diffraction)
