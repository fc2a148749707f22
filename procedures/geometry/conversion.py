"""The same camera in the numbers of other models: exact where the formulas are the same, fitted where they are not.

What a model cannot hold is told in pixels, over the part of the frame that the charts covered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from procedures.geometry.cameras import Camera, simple_camera
from procedures.geometry.uncertainty import enclosed
from procedures.outcome import BadParameter

Array = npt.NDArray[np.float64]

OPENCV_COUNTS = (4, 5, 8, 12)
"""Numbers of distortion coefficients that OpenCV's formula takes."""
SAME = {"PINHOLE": 4, "SIMPLE_RADIAL": 4, "OPENCV": 4, "FULL_OPENCV": 8}
"""COLMAP's models that are OpenCV's formula, and with how many coefficients."""
GRID = (49, 33)


@dataclass(frozen=True)
class Difference:
    """What is lost by a conversion, in pixels: root mean square and largest distance over the covered frame."""

    rms_px: float
    max_px: float


@dataclass(frozen=True, eq=False)
class OpenCvCamera:
    """A camera as OpenCV has it, pixel centres at integers.

    Attributes
    ----------
    focal_px, centre : (x, y)
    distortion : (4,), (5,), (8,) or (12,) float64
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, as far as they go.
    difference : Difference
        From the camera that was measured.
    """

    focal_px: tuple[float, float]
    centre: tuple[float, float]
    distortion: Array
    difference: Difference

    def project(self, rays: Array) -> Array:
        """Where rays (n, 3) are seen, (n, 2)."""
        return opencv_projection(np.array([*self.focal_px, *self.centre, *self.distortion]), rays)


def opencv_projection(params: Array, rays: Array) -> Array:
    """OpenCV's formula: pixels (n, 2) of rays (n, 3), by fx, fy, cx, cy and the coefficients that follow.

    References
    ----------
    OpenCV documentation, module calib3d, "Detailed description".
    """
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = np.pad(params[4:], (0, 16 - len(params)))
    x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
    return np.column_stack([params[0] * u + params[2], params[1] * v + params[3]])


def as_opencv(camera: Camera, region: Array, count: int) -> OpenCvCamera:
    """The camera by OpenCV's formula with `count` distortion coefficients.

    Parameters
    ----------
    region : (m, 2) float64
        Outline of the part of the frame where it is to be the same camera.

    Raises
    ------
    BadParameter
        If OpenCV has no formula of so many coefficients.
    """
    if count not in OPENCV_COUNTS:
        raise BadParameter(f"OpenCV's distortion has {OPENCV_COUNTS} coefficients, not {count}", "give one of these")
    pixels, rays = covered(camera, region)
    if SAME.get(camera.model, 99) <= count:
        params = _same(camera, count)
    else:
        start = np.zeros(4 + count)
        start[:4] = [*camera.focal_px, *camera.centre]
        scale = np.concatenate([np.full(4, camera.focal_px[0]), np.full(count, 0.1)])
        fit = least_squares(
            lambda p: (opencv_projection(p, rays) - pixels).ravel(), start, x_scale=scale, xtol=1e-14, ftol=1e-14
        )
        params = np.asarray(fit.x)
    difference = difference_of(opencv_projection(params, rays) - pixels)
    return OpenCvCamera((params[0], params[1]), (params[2], params[3]), params[4:], difference)


def as_model(camera: Camera, region: Array, model: str) -> tuple[Camera, Difference]:
    """The camera by the formula of another of COLMAP's models, and what that loses.

    Raises
    ------
    BadParameter
        If there is no such model.
    """
    pixels, rays = covered(camera, region)
    start = simple_camera(model, camera.focal_px, camera.centre, (camera.columns, camera.rows))
    scale = np.array([camera.focal_px[0] if unit == "pixel" else 0.1 for unit in start.units])
    fit = least_squares(
        lambda p: (start.with_params(p).project(rays) - pixels).ravel(), start.params, x_scale=scale, xtol=1e-14,
        ftol=1e-14,
    )  # fmt: skip
    found = start.with_params(fit.x)
    return found, difference_of(found.project(rays) - pixels)


def _same(camera: Camera, count: int) -> Array:
    """The numbers of a camera whose formula is OpenCV's."""
    known = dict(zip(camera.names, camera.params, strict=True))
    known.setdefault("k1", known.get("k", 0.0))
    order = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    params = np.zeros(4 + count)
    params[:4] = [*camera.focal_px, *camera.centre]
    for place, name in enumerate(order[:count], 4):
        params[place] = known.get(name, 0.0)
    return params


def covered(camera: Camera, region: Array) -> tuple[Array, Array]:
    """Places of the frame inside an outline, and their rays."""
    pixels = camera.frame_grid(*GRID)
    pixels = pixels[enclosed(region, pixels)]
    rays = camera.rays(pixels)
    known = np.isfinite(rays).all(axis=1)
    return pixels[known], rays[known]


def difference_of(moved: Array) -> Difference:
    """Of places that a conversion moved by (n, 2) pixels."""
    lengths = np.linalg.norm(moved, axis=1)
    return Difference(float(np.sqrt(np.mean(lengths**2))), float(lengths.max()))
