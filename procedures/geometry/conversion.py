"""Conversion of a camera to other models: exact for the same formula, fitted otherwise.

The residual of a fit is given in pixels over the part of the frame that the charts covered.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from scipy.optimize import least_squares

from procedures.geometry.cameras import STEREOGRAPHIC, CameraModel, simple_camera, split_model
from procedures.geometry.uncertainty import enclosed
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter

OPENCV_COUNTS = (4, 5, 8, 12)  # numbers of distortion coefficients supported by OpenCV's formula
SAME_FORMULA = {"PINHOLE": 4, "SIMPLE_RADIAL": 4, "OPENCV": 4, "FULL_OPENCV": 8}
"""COLMAP's models with OpenCV's formula, and their numbers of coefficients."""
GRID = (49, 33)
EQUIVALENT, EXACT_PX = 1.02, 1e-6
"""A simpler model is taken where its error is at most this times the least, or negligible."""
FAR_PX = 1e6  # image, in pixels, of rays that a formula does not project
RADIAL_FORMULAS: dict[str, tuple[tuple[int, ...], int]] = {
    "poly3": ((2,), 1),
    "poly5": ((2, 4), 0),
    "ptlens": ((3, 2, 1), 1),
    "even": ((2, 4, 6), 0),
}
"""The factor 1 + sum k (r^n - c) of the undistorted radius: the powers n, and c. lensfun's three, and a DNG's warp."""


@dataclass(frozen=True)
class Difference:
    """Error of a conversion over the covered frame, in pixels: root mean square and largest distance."""

    rms_px: float
    max_px: float


@dataclass(frozen=True, eq=False)
class OpenCvCamera:
    """A camera as OpenCV defines it, with pixel centres at integers.

    focal_px, centre : (x, y)
    distortion : (4,), (5,), (8,) or (12,) float64, the first of k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4
    difference : Difference, from the measured camera
    """

    focal_px: tuple[float, float]
    centre: tuple[float, float]
    distortion: Array
    difference: Difference

    def project(self, rays: Array) -> Array:
        """Pixels (n, 2) of rays (n, 3)."""
        return _opencv_projection(np.array([*self.focal_px, *self.centre, *self.distortion]), rays)


@dataclass(frozen=True, eq=False)
class RadialCamera:
    """A camera with radial distortion: a factor of the undistorted radius, as in lensfun and in a DNG's warp.

    The focal length of its pinhole may differ from that of the camera, which such files do not define.

    formula : str, one of RADIAL_FORMULAS
    focal_px : float, of the undistorted pinhole
    centre : (x, y) of projection and distortion, in pixels
    unit_px : float, unit of the radius
    coefficients : (n,) float64
    tangential : (2,) float64, decentring p1 (along y) and p2 (along x); 0 where the format has none
    difference : Difference, from the measured camera
    """

    formula: str
    focal_px: float
    centre: tuple[float, float]
    unit_px: float
    coefficients: Array
    tangential: Array
    difference: Difference


def as_opencv(camera: CameraModel, region: Array, count: int) -> OpenCvCamera:
    """The camera by OpenCV's formula with `count` distortion coefficients.

    Raises BadParameter if OpenCV has no formula with so many coefficients.

    region : (m, 2) float64, outline of the part of the frame in which the cameras shall agree
    """
    if count not in OPENCV_COUNTS:
        raise BadParameter(f"OpenCV's distortion has {OPENCV_COUNTS} coefficients, not {count}", "give one of these")
    pixels, rays = covered_grid(camera, region)
    params = np.zeros(4 + count)
    params[:4] = [*camera.focal_px, *camera.centre]
    if SAME_FORMULA.get(camera.model, 99) <= count:
        known = dict(zip(camera.names, camera.params, strict=True))
        known.setdefault("k1", known.get("k", 0.0))
        for place, name in enumerate(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")[:count], 4):
            params[place] = known.get(name, 0.0)
    else:
        scale = np.concatenate([np.full(4, camera.focal_px[0]), np.full(count, 0.1)])
        params = _fit(lambda p: _opencv_projection(p, rays), params, scale, pixels)
    difference = _difference(_opencv_projection(params, rays) - pixels)
    return OpenCvCamera((params[0], params[1]), (params[2], params[3]), params[4:], difference)


def as_model(camera: CameraModel, region: Array, model: str) -> tuple[CameraModel, Difference]:
    """The camera by another of COLMAP's models, and the error.

    Raises BadParameter if there is no such model.
    """
    pixels, rays = covered_grid(camera, region, behind=split_model(model)[0] == STEREOGRAPHIC)
    start = simple_camera(model, camera.focal_px, camera.centre, (camera.columns, camera.rows))
    scale = np.array([camera.focal_px[0] if unit == "pixel" else 0.1 for unit in start.units])

    def project(p: Array) -> Array:
        return np.nan_to_num(start.with_params(p).project(rays), nan=FAR_PX)

    fit = start.with_params(_fit(project, start.params, scale, pixels))
    return fit, _difference(fit.project(rays) - pixels)


@dataclass(frozen=True, eq=False)
class KalibrCamera:
    """A camera as Kalibr defines it, with pixel centres at integers.

    model : str, one of KALIBR_MODELS: its camera model, and its distortion model
    intrinsics : (n,) float64, parameters of the camera model, then fx, fy, cx and cy
    coefficients : (m,) float64, of the distortion
    difference : Difference, from the measured camera
    """

    model: tuple[str, str]
    intrinsics: Array
    coefficients: Array
    difference: Difference

    def project(self, rays: Array) -> Array:
        """Pixels (n, 2) of rays (n, 3)."""
        return _kalibr_projection(self.model, np.concatenate([self.intrinsics, self.coefficients]), rays)


KALIBR_MODELS: dict[tuple[str, str], tuple[tuple[float, ...], tuple[float, ...]]] = {
    ("pinhole", "radtan"): ((), (0.0, 0.0, 0.0, 0.0)),
    ("pinhole", "equidistant"): ((), (0.0, 0.0, 0.0, 0.0)),
    ("pinhole", "fov"): ((), (0.5,)),
    ("omni", "radtan"): ((1.0,), (0.0, 0.0, 0.0, 0.0)),
    ("eucm", "none"): ((0.5, 1.0), ()),
    ("ds", "none"): ((0.0, 0.5), ()),
}
"""Kalibr's camera and distortion models: start of the camera model's parameters before fx, and of the distortion's."""


def as_kalibr(camera: CameraModel, region: Array) -> KalibrCamera:
    """The camera by the first of Kalibr's models that loses about the least over the frame within an outline."""
    pixels, rays = covered_grid(camera, region)
    focal = float(np.mean(camera.focal_px))
    fits = []
    for model, (shape, coefficients) in KALIBR_MODELS.items():
        # at the axis all have the pinhole's magnification for this focal length
        magnification = 1 + shape[0] if model[0] == "omni" else 1.0
        start = np.array([*shape, focal * magnification, focal * magnification, *camera.centre, *coefficients])
        pixel = np.arange(len(start)) - len(shape)
        scale = np.where((pixel >= 0) & (pixel < 4), focal, 0.1)
        params = _fit(partial(_kalibr_at, model, rays), start, scale, pixels)
        own = len(shape) + 4
        lost = _difference(_kalibr_projection(model, params, rays) - pixels)
        fits.append(KalibrCamera(model, params[:own], params[own:], lost))
    least = min(fit.difference.rms_px for fit in fits)
    return next(fit for fit in fits if fit.difference.rms_px <= max(EQUIVALENT * least, EXACT_PX))


def _kalibr_at(model: tuple[str, str], rays: Array, params: Array) -> Array:
    """The projection, far away where the formula has none."""
    return np.nan_to_num(_kalibr_projection(model, params, rays), nan=FAR_PX, posinf=FAR_PX, neginf=-FAR_PX)


def _kalibr_projection(model: tuple[str, str], params: Array, rays: Array) -> Array:
    """Pixels (n, 2) of rays (n, 3). Mei's unified, the extended unified, and the double sphere model; OpenCV's rest."""
    kind, distortion = model
    shape, rest = np.split(params, [len(KALIBR_MODELS[model][0])])
    (fx, fy, cx, cy), k = rest[:4], rest[4:]
    (x, y, z), first = rays.T, np.linalg.norm(rays, axis=1)
    with np.errstate(all="ignore"):
        if kind == "omni":
            depth = z + shape[0] * first
        elif kind == "eucm":
            depth = shape[0] * np.sqrt(shape[1] * (x * x + y * y) + z * z) + (1 - shape[0]) * z
        elif kind == "ds":
            moved = shape[0] * first + z
            depth = shape[1] * np.sqrt(x * x + y * y + moved * moved) + (1 - shape[1]) * moved
        else:
            depth = z
        u, v = x / depth, y / depth
        r2 = u * u + v * v
        r = np.sqrt(np.maximum(r2, np.finfo(float).tiny))
        if distortion == "radtan":
            factor = 1 + k[0] * r2 + k[1] * r2 * r2
            u, v = (
                u * factor + 2 * k[2] * u * v + k[3] * (r2 + 2 * u * u),
                v * factor + 2 * k[3] * u * v + k[2] * (r2 + 2 * v * v),
            )
        elif distortion == "equidistant":
            angle = np.arctan2(r * depth, depth)
            powers = angle[:, None] ** np.array([2, 4, 6, 8])
            u, v = (one * angle * (1 + powers @ k) / r for one in (u, v))
        elif distortion == "fov":
            u, v = (one * np.arctan(2 * r * np.tan(k[0] / 2)) / (k[0] * r) for one in (u, v))
        return np.column_stack([fx * u + cx, fy * v + cy])


def as_radial(
    camera: CameraModel, region: Array, formula: str, unit_px: float, *, decentring: bool = False
) -> RadialCamera:
    """The camera by a radial formula, with fitted focal length and centre.

    Raises BadParameter if there is no such formula.

    region : (m, 2) float64, outline of the part of the frame in which the cameras shall agree
    decentring : bool, whether the format has p1 and p2, too
    """
    if formula not in RADIAL_FORMULAS:
        known = ", ".join(RADIAL_FORMULAS)
        raise BadParameter(f"a radial distortion is one of {known}, not {formula!r}", "name one of them")
    pixels, rays = covered_grid(camera, region)
    flat = rays[:, :2] / rays[:, 2:]
    focal = float(np.mean(camera.focal_px))
    start = np.concatenate([[focal, *camera.centre], np.zeros(2 * decentring + len(RADIAL_FORMULAS[formula][0]))])
    scale = np.concatenate([[focal, unit_px, unit_px], np.full(len(start) - 3, 0.1)])

    def complete(p: Array) -> Array:
        return p if decentring else np.insert(p, 3, [0.0, 0.0])

    def project(p: Array) -> Array:
        return _distorted(flat * p[0] / unit_px, complete(p)[1:], formula, unit_px)

    fit = _fit(project, start, scale, pixels)
    p, difference = complete(fit), _difference(project(fit) - pixels)
    return RadialCamera(formula, float(p[0]), (float(p[1]), float(p[2])), unit_px, p[5:], p[3:5], difference)


def _fit(project: Callable[[Array], Array], start: Array, scale: Array, pixels: Array) -> Array:
    """Parameters whose projection is nearest to the pixels. Differences are taken of the projection: its derivative
    ends where a formula does, and leads a quotient of polynomials to a poor minimum."""
    fit = least_squares(lambda p: (project(p) - pixels).ravel(), start, x_scale=scale, xtol=1e-14, ftol=1e-14)
    return np.asarray(fit.x)


def _opencv_projection(params: Array, rays: Array) -> Array:
    """Pixels (n, 2) of rays (n, 3) by OpenCV, from fx, fy, cx, cy and the coefficients."""
    K = np.array([[params[0], 0, params[2]], [0, params[1], params[3]], [0, 0, 1.0]])
    points = np.ascontiguousarray(rays)[:, None]
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, params[4:])[0]
    return np.asarray(pixels[:, 0], dtype=np.float64)


def _distorted(u: Array, params: Array, formula: str, unit_px: float) -> Array:
    """Pixels of undistorted positions u (n, 2); params are cx, cy, p1, p2 and the coefficients."""
    (cx, cy, p1, p2), k = params[:4], params[4:]
    powers, offset = RADIAL_FORMULAS[formula]
    r = np.linalg.norm(u, axis=1)
    factor = 1 + (r[:, None] ** np.array(powers) - offset) @ k
    x, y = u.T
    tangential = np.column_stack([
        p2 * (r**2 + 2 * x**2) + 2 * p1 * x * y, p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y
    ])  # fmt: skip
    return np.asarray((u * factor[:, None] + tangential) * unit_px + [cx, cy])


def covered_grid(
    camera: CameraModel, region: Array, grid: tuple[int, int] = GRID, *, behind: bool = False
) -> tuple[Array, Array]:
    """Grid of pixels within an outline, and their rays; `behind`: also those that formulas of pinholes do not have."""
    pixels = camera.frame_grid(*grid)
    pixels = pixels[enclosed(region, pixels)]
    rays = camera.rays(pixels)
    known = np.isfinite(rays).all(axis=1) & (behind | (rays[:, 2] > 0))
    return pixels[known], rays[known]


def _difference(errors: Array) -> Difference:
    lengths = np.linalg.norm(errors, axis=1)
    return Difference(float(np.sqrt(np.mean(lengths**2))), float(lengths.max()))
