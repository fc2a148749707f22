"""The nodes' PSFs in units of their noise, and the directions in which they differ most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.field.models import Optic
from procedures.psf_field import Node, in_half_diagonals

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

MOST = 24
"""Directions that are kept."""
FLOOR = 0.05
"""Least variance that noise is taken to have in any direction, of the mean: some directions have none by convention."""


@dataclass(frozen=True, eq=False)
class WhitenedNodes:
    """The nodes' PSFs z in coordinates where the mean noise is 1 in every direction.

    Attributes
    ----------
    z : (N, p), places : (N, 2), trust : (N,)
        Trust is one over the noise's variance, about 1.
    C : (N, p, p)
        Covariances of the PSFs' parameters h: k^2 samples and q amplitudes of the tail, p numbers.
    to, back : (p, p)
        z = to h, h = back z.
    """

    z: Array
    places: Array
    trust: Array
    C: Array
    to: Array
    back: Array
    k: int

    @classmethod
    def of(cls, nodes: Sequence[Node], shape: tuple[int, int]) -> WhitenedNodes:
        """The nodes of a plane with that many rows and columns."""
        covariances = np.array([node.psf.parameter_covariance for node in nodes])
        mean, k = covariances.mean(axis=0), nodes[0].psf.k
        unit = _units(mean, k * k)
        values, vectors = np.linalg.eigh(mean / np.outer(unit, unit))
        root = np.sqrt(np.maximum(values, FLOOR * values.mean()))
        to, back = (vectors / root) @ vectors.T / unit, unit[:, None] * (vectors * root) @ vectors.T
        trust = len(unit) / np.einsum("pq,ipq->i", to.T @ to, covariances)
        z = np.array([node.psf.parameters for node in nodes]) @ to.T
        places = in_half_diagonals(np.array([node.position for node in nodes]), shape)
        return cls(z, places, trust, covariances, to, back, k)

    @property
    def size(self) -> int:
        """Parameters of a PSF, p."""
        return int(self.z.shape[1])

    def basis(self, kept: Indices) -> tuple[Array, Array]:
        """Weighted mean (p,) and principal directions (n, p), the strongest first, of some nodes."""
        known: dict[bytes, tuple[Array, Array]] = self.__dict__.setdefault("_bases", {})
        if kept.tobytes() not in known:
            mean = self.trust[kept] @ self.z[kept] / self.trust[kept].sum()
            X = np.sqrt(self.trust[kept])[:, None] * (self.z[kept] - mean)
            values, vectors = np.linalg.eigh(X @ X.T)
            most = min(len(kept) - 1, MOST)
            strongest = slice(None, -most - 1, -1)
            # nodes without any difference have no directions: rows of zeros do no harm
            size = np.sqrt(np.maximum(values[strongest], 1e-12 * values[-1] + np.finfo(np.float64).tiny))
            known[kept.tobytes()] = mean, (vectors[:, strongest].T @ X) / size[:, None]
        return known[kept.tobytes()]

    def inner(self, V: Array) -> Array:
        """Covariances (N, r, r) of the coefficients along directions (r, p)."""
        analysis = V @ self.to
        return np.asarray(analysis @ self.C @ analysis.T)

    def optic(self, V: Array) -> Optic:
        """The components (r, p) of these directions, for the symmetric model."""
        return Optic(V @ self.to, V @ self.back.T, self.to, self.k)


def _units(covariance: Array, samples: int) -> Array:
    """What each parameter (p,) is counted in: all samples in one unit, their root mean variance, each amplitude in its
    own, as it is no sample of light and may be far more or less certain than one."""
    variance = np.diag(covariance).copy()
    variance[:samples] = variance[:samples].mean()
    return np.asarray(np.sqrt(np.where(variance > 0, variance, variance[:samples].mean())))
