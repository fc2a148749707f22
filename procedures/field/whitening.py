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
class Whitened:
    """The nodes' PSFs z in coordinates where the mean noise is 1 in every direction.

    Attributes
    ----------
    z : (N, k^2), places : (N, 2), trust : (N,)
        Trust is one over the noise's variance, about 1.
    C : (N, k^2, k^2)
        Covariances of h.
    to, back : (k^2, k^2)
        z = to h, h = back z; both symmetric.
    """

    z: Array
    places: Array
    trust: Array
    C: Array
    to: Array
    back: Array
    k: int

    @classmethod
    def of(cls, nodes: Sequence[Node], shape: tuple[int, int]) -> Whitened:
        """The nodes of a plane with that many rows and columns."""
        covariances = np.array([node.psf.covariance for node in nodes])
        values, vectors = np.linalg.eigh(covariances.mean(axis=0))
        root = np.sqrt(np.maximum(values, FLOOR * values.mean()))
        to, back = (vectors / root) @ vectors.T, (vectors * root) @ vectors.T
        psf = nodes[0].psf
        trust = psf.k**2 / np.einsum("pq,ipq->i", to @ to, covariances)
        z = np.array([node.psf.h.ravel() for node in nodes]) @ to
        places = in_half_diagonals(np.array([node.position for node in nodes]), shape)
        return cls(z, places, trust, covariances, to, back, psf.k)

    def basis(self, kept: Indices) -> tuple[Array, Array]:
        """Weighted mean (k^2,) and principal directions (n, k^2), the strongest first, of some nodes."""
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
        """Covariances (N, r, r) of the coefficients along directions (r, k^2)."""
        analysis = V @ self.to
        return np.asarray(analysis @ self.C @ analysis.T)

    def optic(self, V: Array) -> Optic:
        """The components (r, k^2) of these directions, for the symmetric model."""
        return Optic(V @ self.to, V @ self.back, self.to, self.k)
