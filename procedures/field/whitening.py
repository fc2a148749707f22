"""The nodes' PSFs in units of their noise, and the directions in which they differ most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.field.models import AxialSymmetry, Optic, mirrored
from procedures.psf_field import Node, in_half_diagonals

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

MOST = 24
"""Directions that are kept."""
SAME = 1e-6
"""Of the strongest: directions that are hardly there are none."""
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

    def symmetric_basis(self, kept: Indices, degree: int, axis: tuple[float, float]) -> tuple[Array, Array]:
        """The same mean (p,), and the directions (n, p) in which a symmetric lens fitted to these nodes differs most.

        Few nodes do not show all that a lens shows between them: their differences span less than what differs there.
        """
        known: dict[tuple[bytes, int, tuple[float, float]], Array] = self.__dict__.setdefault("_symmetric", {})
        mean = self.basis(kept)[0]
        key = kept.tobytes(), degree, axis
        if key not in known:
            H = self._harmonics(degree)
            origin, places = self.origin(mean, H), self.places[kept]
            lens = AxialSymmetry(places, self.trust[kept], self.optic(H), degree, axis)
            constant, *varying = lens.parts(self.z[kept] @ H.T - origin)
            shown = np.array([constant + origin - H @ mean, *varying])
            size, directions = np.linalg.svd(shown, full_matrices=False)[1:]
            known[key] = directions[size > SAME * size[0]] @ H
        return mean, known[key]

    def _harmonics(self, degree: int) -> Array:
        """All directions (n, p) that rings and tail times waves up to the degree make."""
        known: dict[int, Array] = self.__dict__.setdefault("_waves", {})
        if degree not in known:
            optic = self.optic(np.eye(self.size))
            waves = np.hstack([wave for m in range(degree + 1) for wave in optic.harmonics(m)])
            sums = self.back[: self.k**2].sum(axis=0)
            waves -= np.outer(sums, sums @ waves) / (sums @ sums)  # no direction changes the support's sum
            directions, size = np.linalg.svd(waves, full_matrices=False)[:2]
            known[degree] = directions[:, size > SAME * size[0]].T
        return known[degree]

    def origin(self, mean: Array, V: Array) -> Array:
        """Coefficients (r,) of the mean made symmetric about its centre: what a lens shows on its axis, about."""
        h = self.back @ mean
        return np.asarray(V @ self.to @ (h + mirrored(h, self.k)) / 2)

    def inner(self, V: Array) -> Array:
        """Covariances (N, r, r) of the coefficients along directions (r, p)."""
        analysis = V @ self.to
        return np.asarray(analysis @ self.C @ analysis.T)

    def optic(self, V: Array) -> Optic:
        """The components (r, p) of these directions, for the symmetric model."""
        return Optic(V @ self.to, V @ self.back.T, self.to, self.k, self.__dict__.setdefault("_norms", {}))


def _units(covariance: Array, samples: int) -> Array:
    """What each parameter (p,) is counted in: all samples in one unit, their root mean variance, each amplitude in its
    own, as it is no sample of light and may be far more or less certain than one."""
    variance = np.diag(covariance).copy()
    variance[:samples] = variance[:samples].mean()
    return np.asarray(np.sqrt(np.where(variance > 0, variance, variance[:samples].mean())))
