"""Spline camera: one of COLMAP's models, and a cubic B-spline of its residual distortion.

    q = p + sum_ij B_i(x) B_j(y) c_ij,    p = (x, y) projection by the formula, c_ij in pixels

over a regular grid of control points that spans the frame. Formula and control points are adjusted together. Where both
describe the same displacement, a prior on the control points decides. It is much wider than the uncertainty left by the
views: it affects the division among the parameters, not the projection.

Source: Kogan, mrcal documentation, "Splined stereographic lens model". There the spline is defined on the stereographic
projection; on the frame of a formula it suits narrow and wide lenses, and ends at the frame.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil, comb

import numpy as np
from scipy.linalg import block_diag

from procedures.geometry.cameras import FEWEST_CONTROLS, CameraModel, split_model
from procedures.geometry.node_kernels import add_spline_weights, spline_at
from procedures.numerics.arrays import Array

SPREAD = 5e-4
"""Prior root mean square of the spline, relative to the longer side: the size of decentring and thin prism, which views
hardly distinguish from a shifted principal point."""
ROUGH_PX = 1.0  # standard deviation of third differences of control points that leaves the spline free
LONG_SIDES = (12, 18)  # numbers of control points along the longer side; the spacing along the shorter side is the same
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
    """A camera with model BASE+SPLINE_NXxNY: parameters of the base, then (x, y) of the control points, row by row.

    roughness_px : float, prior standard deviation of the third differences of neighbouring control points
    """

    roughness_px: float = ROUGH_PX

    @classmethod
    def over(cls, base: CameraModel, model: str, roughness_px: float = ROUGH_PX) -> "SplineCamera":
        """The model over a base, with control points at 0."""
        nx, ny = split_model(model)[1]
        params = np.concatenate([base.params, np.zeros(2 * nx * ny)])
        return cls(model, params, base.columns, base.rows, roughness_px)

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

    @cached_property
    def prior(self) -> Array:
        """Prior as a linear map (m, p) from the parameters to values of N(0, 1)."""
        return np.asarray(block_diag(self.base.prior, self._smoothness[0]))

    @cached_property
    def information(self) -> Array:
        """Information (p, p) of the prior."""
        return np.asarray(block_diag(self.base.information, self._smoothness[1]))

    @property
    def _smoothness(self) -> tuple[Array, Array]:
        return _smoothness(*split_model(self.model)[1], SPREAD * max(self.columns, self.rows), self.roughness_px)

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
        places, derivative = self.base.project(points), np.zeros((len(points), 2, len(self.params)))
        derivative[..., : self.plain] = self._displaced(places)[1] @ self.base.by_params(points)
        add_spline_weights(places, self._last, *split_model(self.model)[1], derivative[..., self.plain :])
        return derivative

    def by_points(self, points: Array) -> Array:
        """Derivative (n, 2, 3) of the projection of points (n, 3) by the points."""
        return np.asarray(self._displaced(self.base.project(points))[1] @ self.base.by_points(points))

    def correction(self, places: Array) -> Array:
        """Displacement (n, 2) by the spline at places (n, 2) of the frame, in pixels; constant beyond the frame."""
        return self._displaced(places)[0]

    def _displaced(self, places: Array) -> tuple[Array, Array]:
        """Displacement (n, 2), and derivative (n, 2, 2) of the displaced places by the places (n, 2)."""
        moved, stretched = np.empty_like(places), np.empty((len(places), 2, 2))
        nx, ny = split_model(self.model)[1]
        controls = self.params[self.plain :].reshape(ny, nx, 2)
        spline_at(places, self._last, controls, moved, stretched)
        return moved, stretched

    @property
    def _last(self) -> Array:
        """The last pixel of the frame, (x, y)."""
        return np.array([self.columns - 1.0, self.rows - 1.0])


@lru_cache(maxsize=8)
def _smoothness(nx: int, ny: int, spread_px: float, roughness_px: float) -> tuple[Array, Array]:
    """Prior (m, 2 ny nx) of control points and its information: values, and third differences as of a plate."""
    along, down = ([np.diff(np.eye(count), n, axis=0) for n in range(4)] for count in (nx, ny))
    third = [np.sqrt(comb(3, n)) / roughness_px * np.kron(down[n], along[3 - n]) for n in range(4)]
    one = np.vstack([np.eye(nx * ny) / (spread_px * np.sqrt(nx * ny)), *third])
    return np.kron(one, np.eye(2)), np.kron(one.T @ one, np.eye(2))
