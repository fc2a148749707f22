"""A camera for lenses that no formula draws: one of COLMAP's models, and a cubic B-spline of what it leaves.

    q = p + sum_ij B_i(x) B_j(y) c_ij,    p = (x, y) where the formula puts a point, c_ij in pixels

over a grid of control points that spans the frame, evenly spaced. The formula and the control points are adjusted
together. Where both can draw the same thing a prior on the control points decides, much wider than what views leave
open: what the views tell of the frame does not hang on it, only how that is shared among the numbers.

References
----------
Kogan, mrcal documentation, "Splined stereographic lens model": there the spline lies over the stereographic projection;
over a formula's own frame it serves narrow and wide lenses alike, and ends where the frame does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np
import numpy.typing as npt

from procedures.geometry.cameras import FEWEST, Camera, split_model

Array = npt.NDArray[np.float64]

SPREAD_PX = 3.0
"""Standard deviation of a control point before anything is seen: more than a formula that fits a lens at all leaves."""
LONG_SIDES = (8, 12, 18)
"""Control points along the frame's longer side that are tried; as far apart along the shorter."""
TURNS, STILL_PX = 30, 1e-9
"""Steps at most that take the spline off a place of the frame, and when they end: each leaves a hundredth or so."""


def spline_models(base: str, columns: int, rows: int) -> tuple[str, ...]:
    """The models over a formula that are tried for a frame of that size, the coarsest first."""
    names = []
    for long in LONG_SIDES:
        apart = max(columns, rows) / (long - 3)
        nx, ny = (max(FEWEST, ceil(side / apart) + 3) for side in (columns, rows))
        names.append(f"{base}+SPLINE_{nx}X{ny}")
    return tuple(names)


@dataclass(frozen=True, eq=False)
class SplineCamera(Camera):
    """A camera whose model is called BASE+SPLINE_NXxNY; its numbers are the base's, then (x, y) of every control point.

    The control points go row by row.
    """

    @classmethod
    def over(cls, base: Camera, model: str) -> SplineCamera:
        """A model of a base, its control points at 0."""
        nx, ny = split_model(model)[1]
        return cls(model, np.concatenate([base.params, np.zeros(2 * nx * ny)]), base.columns, base.rows)

    @cached_property
    def base(self) -> Camera:
        """The formula alone."""
        model = split_model(self.model)[0]
        return Camera(model, self.params[: self.plain], self.columns, self.rows)

    @property
    def plain(self) -> int:
        """Number of the base's parameters."""
        nx, ny = split_model(self.model)[1]
        return len(self.params) - 2 * nx * ny

    @property
    def beforehand(self) -> Array:
        """Standard deviations (p,) of the parameters before anything is seen."""
        return np.concatenate([self.base.beforehand, np.full(len(self.params) - self.plain, SPREAD_PX)])

    def project(self, points: Array) -> Array:
        """Where points (n, 3) of the camera's frame are seen, (n, 2); NaN behind it."""
        seen = self.base.project(points)
        return np.asarray(seen + self.correction(seen))

    def rays(self, pixels: Array) -> Array:
        """Directions (x, y, 1) in which pixels (n, 2) look, (n, 3); NaN where the model has none."""
        places = pixels
        for _ in range(TURNS):
            step = pixels - self.correction(places) - places
            places = places + step
            if np.abs(step).max(initial=0.0) < STILL_PX:
                break
        return self.base.rays(places)

    def by_params(self, points: Array) -> Array:
        """Derivative (n, 2, p) of where points (n, 3) are seen with respect to the parameters."""
        places = self.base.project(points)
        weights = self._basis(places)[0].reshape(len(points), -1)
        own = np.einsum("nk,ab->nakb", weights, np.eye(2)).reshape(len(points), 2, -1)
        return np.concatenate([self._stretched(places) @ self.base.by_params(points), own], axis=-1)

    def by_points(self, points: Array) -> Array:
        """Derivative (n, 2, 3) of where points (n, 3) are seen with respect to their place."""
        return np.asarray(self._stretched(self.base.project(points)) @ self.base.by_points(points))

    def correction(self, places: Array) -> Array:
        """What the spline adds (n, 2) at places (n, 2) of the frame, in pixels; beyond the frame as at its rim."""
        return np.asarray(np.einsum("nij,ijb->nb", self._basis(places)[0], self._controls))

    def _stretched(self, places: Array) -> Array:
        """Derivative (n, 2, 2) of where the spline has places (n, 2) with respect to them."""
        slopes = [np.einsum("nij,ijb->nb", one, self._controls) for one in self._basis(places)[1:]]
        return np.asarray(np.eye(2) + np.stack(slopes, axis=-1))

    @property
    def _controls(self) -> Array:
        """The control points, (ny, nx, 2)."""
        nx, ny = split_model(self.model)[1]
        return self.params[self.plain :].reshape(ny, nx, 2)

    def _basis(self, places: Array) -> tuple[Array, Array, Array]:
        """The control points' weights (n, ny, nx) at places (n, 2), and their slopes along x and y, per pixel."""
        (nx, ny), wide, high = split_model(self.model)[1], self.columns - 1, self.rows - 1
        (X, Xs), (Y, Ys) = _splines(places[:, 0] / wide, nx), _splines(places[:, 1] / high, ny)
        products = ((Y, X), (Y, Xs / wide), (Ys / high, X))
        value, along, down = (b[:, :, None] * a[:, None, :] for b, a in products)
        return value, along, down


def _splines(t: Array, count: int) -> tuple[Array, Array]:
    """Values and slopes (n, count) of the cubic B-splines at t (n,) from 0 to 1; constant beyond, NaN where t is."""
    at = np.clip(t, 0.0, 1.0) * (count - 3)
    first = np.minimum(np.nan_to_num(at), count - 4).astype(np.int64)
    u, inside = at - first, (t >= 0) & (t <= 1)
    one = 1 - u
    values = np.stack([one**3, 3 * u**3 - 6 * u**2 + 4, 3 * one**3 - 6 * one**2 + 4, u**3], axis=1) / 6
    slopes = np.stack([-(one**2), 3 * u**2 - 4 * u, 4 * one - 3 * one**2, u**2], axis=1) / 2 * (count - 3)
    places = first[:, None] + np.arange(4)
    full = np.zeros((2, len(t), count))
    np.put_along_axis(full[0], places, values, axis=1)
    np.put_along_axis(full[1], places, slopes * inside[:, None], axis=1)
    return full[0], full[1]
