"""The same camera by a radial formula alone: what lensfun and a DNG's warp hold, the rest told in pixels.

A distortion is a factor of the undistorted radius, in units of a length of the frame; the pinhole that it starts from
may have another focal length than the camera, which such files do not fix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from procedures.geometry.cameras import Camera
from procedures.geometry.conversion import Difference, covered, difference_of
from procedures.outcome import BadParameter

Array = npt.NDArray[np.float64]


def _poly3(r: Array, k: Array) -> Array:
    return np.asarray(1 - k[0] + k[0] * r**2)


def _poly5(r: Array, k: Array) -> Array:
    return np.asarray(1 + k[0] * r**2 + k[1] * r**4)


def _ptlens(r: Array, k: Array) -> Array:
    a, b, c = k
    return np.asarray(a * r**3 + b * r**2 + c * r + 1 - a - b - c)


def _even(r: Array, k: Array) -> Array:
    return np.asarray(1 + k[0] * r**2 + k[1] * r**4 + k[2] * r**6)


FORMULAS: dict[str, tuple[Callable[[Array, Array], Array], int]] = {
    "poly3": (_poly3, 1),
    "poly5": (_poly5, 2),
    "ptlens": (_ptlens, 3),
    "even": (_even, 3),
}
"""The factor of the undistorted radius, and how many coefficients it has: lensfun's three, and r^2, r^4, r^6."""


@dataclass(frozen=True, eq=False)
class RadialCamera:
    """A camera whose distortion is radial.

    Attributes
    ----------
    formula : str
        One of FORMULAS.
    focal_px : float
        Of the pinhole that the factor is of.
    centre : (x, y)
        Of projection and distortion, in pixels.
    unit_px : float
        Length that is 1 of the formula's radius.
    coefficients : (n,) float64
    tangential : (2,) float64
        p1 (along y) and p2 (along x) of decentring, in the formula's units; 0 where the format has none.
    difference : Difference
        From the camera that was measured.
    """

    formula: str
    focal_px: float
    centre: tuple[float, float]
    unit_px: float
    coefficients: Array
    tangential: Array
    difference: Difference

    def distort(self, points: Array) -> Array:
        """Where points (n, 2) of the corrected picture lie in the photograph, (n, 2)."""
        params = np.array([*self.centre, *self.tangential, *self.coefficients])
        return _distorted((points - self.centre) / self.unit_px, params, self.formula, self.unit_px)

    def project(self, rays: Array) -> Array:
        """Where rays (n, 3) are seen, (n, 2)."""
        return self.distort(self.focal_px * rays[:, :2] / rays[:, 2:] + self.centre)


def as_radial(camera: Camera, region: Array, formula: str, unit_px: float, *, decentring: bool = False) -> RadialCamera:
    """The camera by a radial formula, focal length and centre fitted with it.

    Parameters
    ----------
    region : (m, 2) float64
        Outline of the part of the frame where it is to be the same camera.
    decentring : bool
        Whether the format has p1 and p2, too.

    Raises
    ------
    BadParameter
        If there is no such formula.
    """
    if formula not in FORMULAS:
        raise BadParameter(f"a radial distortion is one of {', '.join(FORMULAS)}, not {formula!r}", "name one of them")
    pixels, rays = covered(camera, region)
    flat = rays[:, :2] / rays[:, 2:]
    focal = float(np.mean(camera.focal_px))
    start = np.concatenate([[focal, *camera.centre], np.zeros(2 * decentring + FORMULAS[formula][1])])
    scale = np.concatenate([[focal, unit_px, unit_px], np.full(len(start) - 3, 0.1)])

    def left(p: Array) -> Array:
        full = p[1:] if decentring else np.insert(p[1:], 2, [0.0, 0.0])
        return (_distorted(flat * p[0] / unit_px, full, formula, unit_px) - pixels).ravel()

    fit = least_squares(left, start, x_scale=scale, xtol=1e-14, ftol=1e-14)
    p = np.asarray(fit.x if decentring else np.insert(fit.x, 3, [0.0, 0.0]))
    lost = difference_of(left(fit.x).reshape(-1, 2))
    return RadialCamera(formula, float(p[0]), (float(p[1]), float(p[2])), unit_px, p[5:], p[3:5], lost)


def _distorted(u: Array, params: Array, formula: str, unit_px: float) -> Array:
    """Pixels of undistorted places u (n, 2); params are cx, cy, p1, p2 and the coefficients."""
    (cx, cy, p1, p2), k = params[:4], params[4:]
    r = np.linalg.norm(u, axis=1)
    x, y = u.T
    moved = u * FORMULAS[formula][0](r, k)[:, None] + np.column_stack([
        p2 * (r**2 + 2 * x**2) + 2 * p1 * x * y, p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y
    ])  # fmt: skip
    return np.asarray(moved * unit_px + [cx, cy])
