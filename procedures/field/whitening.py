"""The nodes' PSFs in units of their noise, and the principal directions of their variation."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.field.models import AxialSymmetry, Optic, mirrored
from procedures.numerics.arrays import Array
from procedures.psf_field import Node, in_half_diagonals

Indices = npt.NDArray[np.intp]

MAX_DIRECTIONS = 24  # most principal directions kept
RANK_TOLERANCE = 1e-6  # smallest singular value of a direction, relative to the largest
FLOOR = 0.05  # minimum noise variance in any direction, relative to the mean: some directions have none by convention


@dataclass(frozen=True, eq=False)
class WhitenedNodes:
    """The nodes' PSFs z in coordinates in which the mean noise is 1 in every direction.

    z : (N, p), places : (N, 2), trust : (N,); `trust` is the inverse variance of the noise, about 1
    C : (N, p, p), covariances of the PSFs' parameters h: k^2 samples and q amplitudes of the tail
    to, back : (p, p), z = to h, h = back z
    """

    z: Array
    places: Array
    trust: Array
    C: Array
    to: Array
    back: Array
    k: int
    _cache: dict[Any, Any] = field(default_factory=dict)
    _norms: dict[int, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, nodes: Sequence[Node], shape: tuple[int, int]) -> "WhitenedNodes":
        """The nodes of a plane with that many rows and columns."""
        covariances = np.array([node.psf.parameter_covariance for node in nodes])
        mean, k = covariances.mean(axis=0), nodes[0].psf.k
        # unit of each parameter (p,): the root mean variance for all samples, its own for each amplitude, which may be
        # far more or less certain than a sample
        samples = k * k
        variance = np.diag(mean).copy()
        variance[:samples] = variance[:samples].mean()
        unit = np.asarray(np.sqrt(np.where(variance > 0, variance, variance[:samples].mean())))
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
        """Weighted mean (p,) and principal directions (n, p) of some nodes, the strongest first."""
        key = kept.tobytes()
        if key not in self._cache:
            mean = self.trust[kept] @ self.z[kept] / self.trust[kept].sum()
            X = np.sqrt(self.trust[kept])[:, None] * (self.z[kept] - mean)
            values, vectors = np.linalg.eigh(X @ X.T)
            strongest = slice(None, -min(len(kept) - 1, MAX_DIRECTIONS) - 1, -1)
            # identical nodes have no directions: rows of zeros are harmless
            size = np.sqrt(np.maximum(values[strongest], 1e-12 * values[-1] + np.finfo(np.float64).tiny))
            self._cache[key] = mean, (vectors[:, strongest].T @ X) / size[:, None]
        mean, directions = self._cache[key]
        return mean, directions

    def symmetric_basis(self, kept: Indices, degree: int, axis: tuple[float, float]) -> tuple[Array, Array]:
        """The mean (p,) and principal directions (n, p) of a fitted symmetric lens: few nodes do not span the variation
        between them."""
        mean = self.basis(kept)[0]
        key = kept.tobytes(), degree, axis
        if key not in self._cache:
            H = self._harmonics(degree)
            origin, places = self.origin(mean, H), self.places[kept]
            lens = AxialSymmetry(places, self.trust[kept], self.optic(H), degree, axis)
            constant, *varying = lens.parts(self.z[kept] @ H.T - origin)
            terms = np.array([constant + origin - H @ mean, *varying])
            size, directions = np.linalg.svd(terms, full_matrices=False)[1:]
            self._cache[key] = directions[size > RANK_TOLERANCE * size[0]] @ H
        return mean, self._cache[key]

    def _harmonics(self, degree: int) -> Array:
        """Directions (n, p) spanned by rings and tail times waves up to the degree."""
        if degree not in self._cache:
            optic = self.optic(np.eye(self.size))
            waves = np.hstack([wave for m in range(degree + 1) for wave in optic.harmonics(m)])
            sums = self.back[: self.k**2].sum(axis=0)
            waves -= np.outer(sums, sums @ waves) / (sums @ sums)  # no direction changes the support's sum
            directions, size = np.linalg.svd(waves, full_matrices=False)[:2]
            self._cache[degree] = directions[:, size > RANK_TOLERANCE * size[0]].T
        return np.asarray(self._cache[degree])

    def origin(self, mean: Array, V: Array) -> Array:
        """Coefficients (r,) of the mean, symmetrised about its centre: approximately the PSF on the axis."""
        h = self.back @ mean
        return np.asarray(V @ self.to @ (h + mirrored(h, self.k)) / 2)

    def inner(self, V: Array) -> Array:
        """Covariances (N, r, r) of the coefficients along directions (r, p)."""
        analysis = V @ self.to
        return np.asarray(analysis @ self.C @ analysis.T)

    def optic(self, V: Array) -> Optic:
        """The components (r, p) of these directions, for the symmetric model."""
        return Optic(V @ self.to, V @ self.back.T, self.to, self.k, self._norms)
