"""Camera models by COLMAP's formulas, or the stereographic one: projection, rays, and derivatives.

COLMAP has pixel centres at 0.5, this project at integers. The half pixel is added where parameters pass to pycolmap.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.linalg import block_diag

from procedures.geometry import stereographic
from procedures.geometry.colmap import pycolmap
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter

MODELS = ("SIMPLE_RADIAL", "OPENCV", "FULL_OPENCV", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE")
"""Models of COLMAP, the simplest first."""
STEREOGRAPHIC = "STEREOGRAPHIC"  # the formula of `stereographic`, which COLMAP does not have
OTHER_MODELS = ("PINHOLE", "OPENCV_FISHEYE", STEREOGRAPHIC)
"""Further models, used on request, in exports, and under splines."""
COLMAP_CENTRE = 0.5
CENTRE = ("cx", "cy")
PIXELS = ("f", "fx", "fy", *CENTRE)  # parameters in pixels; the others are dimensionless
PRIOR = 1.0
"""Prior standard deviation of distortion coefficients. It matters only where views hardly determine them: in a quotient
of two nearly equal polynomials (FULL_OPENCV) it keeps both from diverging."""
ASYMMETRIC_PRIOR = 3e-3
"""Prior of decentring and thin prism, which views hardly distinguish from a principal point far from the centre."""
FORMULAS = ("SIMPLE_RADIAL", "OPENCV", "OPENCV_FISHEYE", *MODELS[2:], STEREOGRAPHIC)
"""Parametric models that are fitted to a reference camera, the simplest first."""
SPLINE = "+SPLINE_"
NESTED = (
    {"PINHOLE": 0, "SIMPLE_RADIAL": 1, "OPENCV": 2, "FULL_OPENCV": 3},
    {"OPENCV_FISHEYE": 0, "THIN_PRISM_FISHEYE": 1},
)
"""Families of models that contain the simpler ones; parameters of the same name have the same meaning."""
FEWEST_CONTROLS = 4  # control points of a cubic B-spline along a side, at least
STEP_PX, STEP, STEP_SHARE = 1e-2, 1e-6, 1e-5
"""Steps of central differences: for parameters in pixels, dimensionless ones, and points relative to their distance.
The formulas are smooth and in double precision: the error stays below 1e-6 of the derivative."""


@dataclass(frozen=True, eq=False)
class CameraModel:
    """A camera model with its parameters.

    model : str, name of the model
    params : (p,) float64, in the order of `names`; the principal point with pixel centres at integers
    columns, rows : int, size of the frame
    """

    model: str
    params: Array
    columns: int
    rows: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return parameter_names(self.model)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters: "pixel" or "1"."""
        return tuple("pixel" if name in PIXELS or name.startswith("spline") else "1" for name in self.names)

    @cached_property
    def prior(self) -> Array:
        """Prior as a linear map (m, p) from the parameters to values of N(0, 1)."""
        asymmetric = stereographic.PRIOR if self.model == STEREOGRAPHIC else ASYMMETRIC_PRIOR
        of_names = (asymmetric if name[0] in "ps" else PRIOR for name in self.names)
        return np.diag([0.0 if unit == "pixel" else 1 / one for unit, one in zip(self.units, of_names, strict=True)])

    @cached_property
    def information(self) -> Array:
        """Information (p, p) of the prior."""
        return np.asarray(self.prior.T @ self.prior)

    @property
    def focal_px(self) -> tuple[float, float]:
        """Focal length along x and y."""
        names = self.names
        return (self._value("f"),) * 2 if "f" in names else (self._value("fx"), self._value("fy"))

    @property
    def centre(self) -> tuple[float, float]:
        """The principal point (x, y)."""
        return self._value("cx"), self._value("cy")

    def _value(self, name: str) -> float:
        return float(self.params[self.names.index(name)])

    def part(self, camera: int) -> tuple[CameraModel, slice]:
        """A camera of several, and the place of its parameters: here itself."""
        return self, slice(0, len(self.params))

    def with_params(self, params: Array) -> CameraModel:
        """The model with other parameters."""
        return replace(self, params=np.asarray(params, dtype=np.float64))

    def colmap(self) -> pycolmap.Camera:
        """The camera for pycolmap, with pixel centres at 0.5."""
        params = self.params + COLMAP_CENTRE * _is_centre(self.model)
        return pycolmap.Camera(model=self.model, width=self.columns, height=self.rows, params=params)

    @cached_property
    def _colmap(self) -> pycolmap.Camera:
        """Cached camera for pycolmap; not to be modified."""
        return self.colmap()

    @classmethod
    def from_colmap(cls, camera: pycolmap.Camera) -> CameraModel:
        """The camera from one of pycolmap."""
        model = camera.model.name
        params = np.array(camera.params, dtype=np.float64) - COLMAP_CENTRE * _is_centre(model)
        return cls(model, params, camera.width, camera.height)

    def project(self, points: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) in the camera's frame (x right, y down, z away); NaN where it has none."""
        if self.model == STEREOGRAPHIC:
            return stereographic.project(self.params, points)
        return _projected(self._colmap, np.ascontiguousarray(points))

    def rays(self, pixels: Array) -> Array:
        """Directions (n, 3), of any length, of pixels (n, 2); NaN where the model has none."""
        if self.model == STEREOGRAPHIC:
            return stereographic.rays(self.params, pixels)
        flat = self._colmap.cam_from_img(np.ascontiguousarray(pixels + COLMAP_CENTRE))
        return np.column_stack([np.asarray(flat, dtype=np.float64)[:, :2], np.ones(len(pixels))])

    def by_params(self, points: Array) -> Array:
        """Derivative (n, 2, p) of the projection of points (n, 3) by the parameters."""
        if self.model == STEREOGRAPHIC:
            return stereographic.by_params(self.params, points)
        theirs, points, columns = self.colmap(), np.ascontiguousarray(points), []
        params = np.array(theirs.params)
        for i, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            if name in CENTRE:  # all points move with it
                columns.append(np.tile([float(name == one) for one in CENTRE], (len(points), 1)))
                continue
            step = np.zeros(len(params))
            step[i] = STEP_PX if unit == "pixel" else STEP
            theirs.params = (params + step).tolist()
            more = _projected(theirs, points)
            theirs.params = (params - step).tolist()
            columns.append((more - _projected(theirs, points)) / (2 * step[i]))
        return np.stack(columns, axis=-1)

    def by_points(self, points: Array) -> Array:
        """Derivative (n, 2, 3) of the projection of points (n, 3) by the points."""
        if self.model == STEREOGRAPHIC:
            return stereographic.by_points(self.params, points)
        step = STEP_SHARE * np.linalg.norm(points, axis=1)
        theirs, columns = self._colmap, []
        for axis in np.eye(3):
            move = step[:, None] * axis
            change = _projected(theirs, points + move) - _projected(theirs, points - move)
            columns.append(change / (2 * step[:, None]))
        return np.stack(columns, axis=-1)

    def frame_grid(self, columns: int, rows: int) -> Array:
        """Regular grid (columns * rows, 2) over the frame, row by row, including its edges."""
        x, y = np.meshgrid(np.linspace(0, self.columns - 1, columns), np.linspace(0, self.rows - 1, rows))
        return np.column_stack([x.ravel(), y.ravel()])


@dataclass(frozen=True, eq=False)
class CameraSet(CameraModel):
    """Several cameras, with the parameters of all one after the other; projections are those of its parts."""

    cameras: tuple[CameraModel, ...] = ()

    @classmethod
    def of(cls, cameras: Sequence[CameraModel]) -> CameraSet:
        """The set of these cameras."""
        params = np.concatenate([camera.params for camera in cameras])
        return cls(" and ".join(camera.model for camera in cameras), params, 0, 0, tuple(cameras))

    @cached_property
    def prior(self) -> Array:
        """Prior as a linear map (m, p) from the parameters to values of N(0, 1)."""
        return np.asarray(block_diag(*(camera.prior for camera in self.cameras)))

    @cached_property
    def information(self) -> Array:
        """Information (p, p) of the prior."""
        return np.asarray(block_diag(*(camera.information for camera in self.cameras)))

    def part(self, camera: int) -> tuple[CameraModel, slice]:
        """A camera, and the place of its parameters."""
        first = sum(len(one.params) for one in self.cameras[:camera])
        return self.cameras[camera], slice(first, first + len(self.cameras[camera].params))

    def with_params(self, params: Array) -> CameraSet:
        """The cameras with other parameters."""
        parts = (self.part(i) for i in range(len(self.cameras)))
        return CameraSet.of([one.with_params(params[place]) for one, place in parts])


def simple_camera(
    model: str, focal_px: tuple[float, float], centre: tuple[float, float], size: tuple[int, int]
) -> CameraModel:
    """A camera without distortion.

    Raises BadParameter if there is no such model.

    focal_px, centre : (x, y)
    size : (columns, rows)
    """
    names = parameter_names(model)
    known = {"f": sum(focal_px) / 2, "fx": focal_px[0], "fy": focal_px[1], "cx": centre[0], "cy": centre[1]}
    return CameraModel(model, np.array([known.get(name, 0.0) for name in names]), *size)


def enriched(camera: CameraModel, model: str) -> CameraModel | None:
    """The camera as a model that contains its own; None where the model does not."""
    if not any(camera.model in family and family[camera.model] <= family.get(model, -1) for family in NESTED):
        return None
    (fx, fy), known = camera.focal_px, dict(zip(camera.names, camera.params.tolist(), strict=True))
    known |= {"f": fx, "fx": fx, "fy": fy}
    known.setdefault("k1", known.get("k", 0.0))
    return CameraModel(
        model, np.array([known.get(name, 0.0) for name in parameter_names(model)]), camera.columns, camera.rows
    )


def _projected(theirs: pycolmap.Camera, points: Array) -> Array:
    """Projection (n, 2) of points (n, 3) by pycolmap's camera, with pixel centres at integers."""
    return np.asarray(theirs.img_from_cam(points), dtype=np.float64) - COLMAP_CENTRE


@cache
def parameter_names(model: str) -> tuple[str, ...]:
    """Names of a model's parameters. Raises BadParameter where there is no such model."""
    base, (nx, ny) = split_model(model)
    names = (
        stereographic.NAMES
        if base == STEREOGRAPHIC
        else tuple(pycolmap.Camera.create_from_model_name(0, base, 1.0, 1, 1).params_info.split(", "))
    )
    return names + tuple(f"spline_{axis}_{i}_{j}" for j in range(ny) for i in range(nx) for axis in "xy")


@cache
def split_model(model: str) -> tuple[str, tuple[int, int]]:
    """The formula of a model, and the control points of its spline along x and y: (0, 0) without one.

    Raises BadParameter if there is no such model.
    """
    base, spline, grid = model.partition(SPLINE)
    counts = re.fullmatch("([0-9]{1,2})X([0-9]{1,2})", grid)
    nx, ny = (int(counts[1]), int(counts[2])) if counts else (0, 0)
    if base not in (*MODELS, *OTHER_MODELS) or (spline and min(nx, ny) < FEWEST_CONTROLS):
        known = ", ".join((*MODELS, *OTHER_MODELS))
        raise BadParameter(
            f"there is no camera model {model!r}", f"name one of {known}, or append a spline: {SPLINE}12X9"
        )
    return base, (nx, ny)


@cache
def _is_centre(model: str) -> Array:
    """1 where a parameter is a coordinate of the principal point, (p,)."""
    return np.array([float(name in CENTRE) for name in parameter_names(model)])


def distortion(camera: CameraModel, pixels: Array) -> Array:
    """Displacement (n, 2), in pixels, at places (n, 2) of the frame, relative to a pinhole of the same focal length."""
    rays = camera.rays(pixels)
    pinhole = rays[:, :2] / np.where(rays[:, 2:] > 0, rays[:, 2:], np.nan) * camera.focal_px + camera.centre
    return np.asarray(pixels - pinhole)
