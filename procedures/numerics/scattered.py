"""Interpolation of values at scattered places of the plane: linear smoothers, each a matrix of weights.

The prediction is `weights(points) @ values`, so its variance follows from that of the values; weights sum to 1.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from procedures.numerics.arrays import Array, Mask

if TYPE_CHECKING:
    from scipy.interpolate import RBFInterpolator


class Smoother(Protocol):
    """Prediction from values at N places."""

    def weights(self, points: Array) -> Array:
        """(n, N): row j predicts at points[j]."""


def monomials(points: Array, degree: int) -> Array:
    """All x^a y^b with a + b <= degree at points (n, 2), lowest degree first: (n, (degree + 1)(degree + 2) / 2)."""
    x, y = np.asarray(points, dtype=np.float64).T
    return np.stack([x ** (d - b) * y**b for d in range(degree + 1) for b in range(d + 1)], axis=1)


@dataclass(frozen=True, eq=False)
class Polynomial:
    """Weighted least squares by a polynomial; places : (N, 2) best within [-1, 1]; trust : (N,) inverse variances.
    Raises ValueError if the places do not determine it."""

    places: Array
    trust: Array
    degree: int

    def __post_init__(self) -> None:
        design = monomials(self.places, self.degree)
        if len(design) < design.shape[1] or np.linalg.matrix_rank(design, tol=1e-6 * len(design)) < design.shape[1]:
            raise ValueError(f"{len(design)} places do not determine a polynomial of degree {self.degree}")

    def weights(self, points: Array) -> Array:
        return np.asarray(monomials(points, self.degree) @ self._solution)

    @cached_property
    def _solution(self) -> Array:
        """Coefficients (c, N) per value."""
        root = np.sqrt(self.trust)
        return np.asarray(np.linalg.pinv(monomials(self.places, self.degree) * root[:, None]) * root)


@dataclass(frozen=True, eq=False)
class ThinPlate:
    """Thin-plate spline with a linear part; interpolates the values where `stiffness` is 0.

    places : (N, 2) float64, trust : (N,) float64; as in `Polynomial`; at least three places, not on a line
    stiffness : weight of the bending energy: mean trust (value - prediction)^2 + stiffness times the energy is
        minimised

    Source: Wahba, Spline Models for Observational Data, 1990, section 2.4.
    """

    places: Array
    trust: Array
    stiffness: float = 0.0

    def weights(self, points: Array) -> Array:
        return np.asarray(self._splines(points))

    @cached_property
    def _splines(self) -> "RBFInterpolator":
        """Through 1 at one of the places and 0 at the others, for each."""
        from scipy.interpolate import RBFInterpolator

        n, relative = len(self.places), self.trust / self.trust.mean()
        return RBFInterpolator(self.places, np.eye(n), smoothing=self.stiffness * n / relative)


def hull_area(points: Array) -> float:
    """Area of the convex hull of points (n, 2); 0 where they lie on a line."""
    try:
        return float(ConvexHull(points).volume)  # in two dimensions that is the area
    except QhullError:
        return 0.0


@dataclass(frozen=True, eq=False)
class Hull:
    """The convex hull of places (N, 2). Raises ValueError if they lie on a line."""

    places: Array

    def __post_init__(self) -> None:
        try:
            hull = ConvexHull(self.places)
        except (QhullError, ValueError) as error:
            raise ValueError("a hull needs three places that do not lie on one line") from error
        object.__setattr__(self, "_sides", hull.equations)
        object.__setattr__(self, "_rim", self.places[hull.vertices])

    @property
    def rim(self) -> Array:
        """Its corners in order around, (m, 2)."""
        rim: Array = self.__dict__["_rim"]
        return rim

    def holds(self, points: Array) -> Mask:
        """Whether each of the points (n, 2) lies inside or, within rounding, on the rim."""
        near = self.nearest(points)
        size = float(np.ptp(self.places, axis=0).max())
        inside: Mask = np.linalg.norm(near - points, axis=1) <= 1e-9 * size
        return inside

    def nearest(self, points: Array) -> Array:
        """The points (n, 2); those outside moved to the nearest point of the hull."""
        points = np.array(points, dtype=np.float64)
        sides = self.__dict__["_sides"]
        outside = np.flatnonzero((points @ sides[:, :2].T + sides[:, 2] > 0).any(axis=1))
        if not len(outside):
            return points
        a, b = self.rim, np.roll(self.rim, -1, axis=0)
        out = points[outside][:, None]
        along = np.sum((out - a) * (b - a), axis=2) / np.sum((b - a) ** 2, axis=1)
        feet = a + np.clip(along, 0, 1)[..., None] * (b - a)
        best = np.argmin(np.linalg.norm(feet - out, axis=2), axis=1)
        points[outside] = feet[np.arange(len(outside)), best]
        return points
