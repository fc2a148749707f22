"""Spline camera: one of COLMAP's models, and a cubic B-spline of its residual distortion.

    q = p + sum_ij B_i(x) B_j(y) c_ij,    p = (x, y) projection by the formula, c_ij in pixels

over a regular grid of control points that spans the frame. Formula and control points are adjusted together. Where both
describe the same displacement, a prior on the control points decides. It is much wider than the uncertainty left by the
views: it affects the division among the parameters, not the projection.

References
----------
Kogan, mrcal documentation, "Splined stereographic lens model". There the spline is defined on the stereographic
projection; on the frame of a formula it suits narrow and wide lenses, and ends at the frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from procedures.geometry.cameras import FEWEST_CONTROLS, CameraModel, split_model

Array = npt.NDArray[np.float64]

SPREAD_PX = 3.0
"""Prior standard deviation of a control point: more than the residual of any formula that suits the lens."""
LONG_SIDES = (8, 12, 18)
"""Candidate numbers of control points along the longer side; the spacing along the shorter side is the same."""
MAX_ITERATIONS, TOLERANCE_PX = 30, 1e-9
"""Limits of the fixed-point iteration that inverts the spline; each iteration reduces the error about a hundredfold."""


def spline_models(base: str, columns: int, rows: int) -> tuple[str, ...]:
    """The spline models over a formula for a frame of that size, the coarsest first."""
    names = []
    for long in LONG_SIDES:
        apart = max(columns, rows) / (long - 3)
        nx, ny = (max(FEWEST_CONTROLS, ceil(side / apart) + 3) for side in (columns, rows))
        names.append(f"{base}+SPLINE_{nx}X{ny}")
    return tuple(names)


@dataclass(frozen=True, eq=False)
class SplineCamera(CameraModel):
    """A camera with model BASE+SPLINE_NXxNY: parameters of the base, then (x, y) of the control points, row by row."""

    @classmethod
    def over(cls, base: CameraModel, model: str) -> SplineCamera:
        """The model over a base, with control points at 0."""
        nx, ny = split_model(model)[1]
        return cls(model, np.concatenate([base.params, np.zeros(2 * nx * ny)]), base.columns, base.rows)

    @cached_property
    def base(self) -> CameraModel:
        """The formula alone."""
        model = split_model(self.model)[0]
        return CameraModel(model, self.params[: self.plain], self.columns, self.rows)

    @property
    def plain(self) -> int:
        """Number of the base's parameters."""
        nx, ny = split_model(self.model)[1]
        return len(self.params) - 2 * nx * ny

    @property
    def prior(self) -> Array:
        """Prior standard deviations (p,) of the parameters about 0."""
        return np.concatenate([self.base.prior, np.full(len(self.params) - self.plain, SPREAD_PX)])

    def project(self, points: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) in the camera's frame; NaN behind it."""
        projected = self.base.project(points)
        return np.asarray(projected + self.correction(projected))

    def rays(self, pixels: Array) -> Array:
        """Directions (n, 3) of pixels (n, 2); NaN where the model has none."""
        places = pixels
        for _ in range(MAX_ITERATIONS):
            step = pixels - self.correction(places) - places
            places = places + step
            if np.abs(step).max(initial=0.0) < TOLERANCE_PX:
                break
        return self.base.rays(places)

    def by_params(self, points: Array) -> Array:
        """Derivative (n, 2, p) of the projection of points (n, 3) by the parameters."""
        places = self.base.project(points)
        weights = self._basis(places)[0].reshape(len(points), -1)
        own = np.einsum("nk,ab->nakb", weights, np.eye(2)).reshape(len(points), 2, -1)
        return np.concatenate([self._stretched(places) @ self.base.by_params(points), own], axis=-1)

    def by_points(self, points: Array) -> Array:
        """Derivative (n, 2, 3) of the projection of points (n, 3) by the points."""
        return np.asarray(self._stretched(self.base.project(points)) @ self.base.by_points(points))

    def correction(self, places: Array) -> Array:
        """Displacement (n, 2) by the spline at places (n, 2) of the frame, in pixels; constant beyond the frame."""
        return np.asarray(np.einsum("nij,ijb->nb", self._basis(places)[0], self._controls))

    def _stretched(self, places: Array) -> Array:
        """Derivative (n, 2, 2) of the displaced places by the places (n, 2)."""
        slopes = [np.einsum("nij,ijb->nb", one, self._controls) for one in self._basis(places)[1:]]
        return np.asarray(np.eye(2) + np.stack(slopes, axis=-1))

    @property
    def _controls(self) -> Array:
        """The control points, (ny, nx, 2)."""
        nx, ny = split_model(self.model)[1]
        return self.params[self.plain :].reshape(ny, nx, 2)

    def _basis(self, places: Array) -> tuple[Array, Array, Array]:
        """Weights (n, ny, nx) of the control points at places (n, 2), and their slopes along x and y, per pixel."""
        (nx, ny), wide, high = split_model(self.model)[1], self.columns - 1, self.rows - 1
        (X, Xs), (Y, Ys) = _splines(places[:, 0] / wide, nx), _splines(places[:, 1] / high, ny)
        products = ((Y, X), (Y, Xs / wide), (Ys / high, X))
        value, along, down = (b[:, :, None] * a[:, None, :] for b, a in products)
        return value, along, down


def _splines(t: Array, count: int) -> tuple[Array, Array]:
    """Values and slopes (n, count) of the cubic B-splines at t (n,) from 0 to 1; constant beyond, NaN where t is."""
    spline = BSpline((np.arange(count + 4) - 3) / (count - 3), np.eye(count), 3)
    clipped, inside = np.clip(t, 0.0, 1.0), (t >= 0) & (t <= 1)
    return spline(clipped), spline.derivative()(clipped) * inside[:, None]
