"""Score tests of corruptions by the residual of a fit: strengths along directions that the fit's model cannot follow.

The residual r of a fit with the columns M, in units of the noise, is regressed on a direction g whose part within M is
removed: with P that projection, the strength is g'P r / g'P g. Its uncertainty is the larger one of two: by the noise,
and by the scatter of the contributions g'P r of parts of the picture, which includes model errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.corruption.family import threshold
from procedures.numerics.arrays import Array, Array32, Indices


@dataclass(frozen=True)
class Strength:
    """Strength of a corruption and its standard uncertainty, infinite where the data do not determine it."""

    value: float = 0.0
    uncertainty: float = np.inf

    @property
    def score(self) -> float:
        """The strength over its uncertainty."""
        return self.value / self.uncertainty

    @property
    def unseen(self) -> float:
        """The strength, at most what a test lets pass."""
        return min(self.value, threshold() * self.uncertainty) if np.isfinite(self.uncertainty) else 0.0


@dataclass(frozen=True)
class SampleGroup:
    """Samples with nuisance parameters of their own.

    Attributes
    ----------
    shared : (m, n) float32 columns of the parameters that all parts share, divided by the noise
    own : (m, p) columns of its own nuisance parameters
    residual : (m,) float64
    cluster : (m,) int64 numbers, from 0, of the places whose contributions are independent
    """

    shared: Array32
    own: Array
    residual: Array
    cluster: Indices

    def without_own(self, columns: Array) -> Array:
        """Columns (m, d) without what the part's own parameters explain."""
        return np.asarray(columns - self.own @ (np.linalg.pinv(self.own.T @ self.own) @ (self.own.T @ columns)))

    def projected_gram(self) -> Array:
        """Gram matrix (n, n) of the shared columns without the part's own parameters."""
        AZ = (self.shared.T @ self.own.astype(np.float32)).astype(np.float64)
        AA = np.asarray(self.shared.T @ self.shared, dtype=np.float64)
        return np.asarray(AA - AZ @ np.linalg.pinv(self.own.T @ self.own) @ AZ.T)


def strengths(parts: Sequence[SampleGroup], directions: Sequence[Array], gram: Array, noise: float) -> list[Strength]:
    """Strength along each direction, each by itself.

    Parameters
    ----------
    directions : values in each part, divided by the noise
    gram : (n, n) sum of the parts' projected Gram matrices, with the priors of the shared parameters
    noise : standard deviation of the residual
    """
    columns = [np.column_stack([one, part.residual]) for part, one in zip(parts, directions, strict=True)]
    free = [part.without_own(one) for part, one in zip(parts, columns, strict=True)]
    right = np.sum([part.shared.T @ one.astype(np.float32) for part, one in zip(parts, free, strict=True)], axis=0)
    followed = np.linalg.solve(gram, right.astype(np.float64)).astype(np.float32)
    left = [
        one - part.without_own((part.shared @ followed).astype(np.float64))
        for part, one in zip(parts, free, strict=True)
    ]
    power = np.maximum(sum(np.sum(one[:, :-1] ** 2, axis=0) for one in left), 1e-30)
    value = sum(one[:, -1] @ one[:, :-1] for one in left) / power
    square, count = np.zeros(len(value)), 0
    for part, one in zip(parts, left, strict=True):
        places = int(part.cluster.max(initial=-1)) + 1
        terms = one[:, :-1] * (one[:, -1:] - one[:, :-1] * value)
        square += [float(np.sum(np.bincount(part.cluster, term, places) ** 2)) for term in terms.T]
        count += places
    scatter = np.sqrt(square * count / max(count - 1, 1)) / power
    return [Strength(float(a), float(max(noise * p**-0.5, u))) for a, p, u in zip(value, power, scatter, strict=True)]
