"""Camera models: where points before the camera are seen, and how that changes; the formulas are COLMAP's.

COLMAP has its pixel centres at 0.5, this project at integers. The numbers of a `Camera` are this project's; the half
pixel is added at the one place where they are handed to pycolmap.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import numpy.typing as npt
import pycolmap

from procedures.outcome import BadParameter

Array = npt.NDArray[np.float64]

MODELS = ("SIMPLE_RADIAL", "OPENCV", "FULL_OPENCV", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE")
"""Models that are tried, the poorest first."""
OTHER_MODELS = ("PINHOLE", "OPENCV_FISHEYE")
"""Models that are taken where they are asked for, and written into files."""
COLMAP_CENTRE = 0.5
CENTRE = ("cx", "cy")
PIXELS = ("f", "fx", "fy", *CENTRE)
"""Parameters in pixels; the others are plain numbers."""
PLAIN = 1.0
"""Standard deviation beforehand of a distortion's numbers. Views tell them far better, but for a quotient of two
polynomials that are nearly the same (FULL_OPENCV), where only this keeps both from running away together."""
SPLINE = "+SPLINE_"
NESTED = (
    {"PINHOLE": 0, "SIMPLE_RADIAL": 1, "OPENCV": 2, "FULL_OPENCV": 3},
    {"OPENCV_FISHEYE": 0, "THIN_PRISM_FISHEYE": 1},
)
"""Families of models in which each draws all that the poorer ones draw, parameters of one name meaning the same."""
FEWEST = 4
"""Control points of a cubic B-spline along a side."""
STEP_PX, STEP, STEP_SHARE = 1e-2, 1e-6, 1e-5
"""Of central differences: parameters in pixels, plain ones, and a point over its distance. The formulas are smooth and
computed in double precision: both errors stay below 1e-6 of the derivative."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera model with its numbers.

    Attributes
    ----------
    model : str
        A name of COLMAP's camera models.
    params : (p,) float64
        In COLMAP's order, `names`; the principal point is in pixels whose centres lie at integers.
    columns, rows : int
        Size of the frame.
    """

    model: str
    params: Array
    columns: int
    rows: int

    @property
    def names(self) -> tuple[str, ...]:
        """What the parameters are called."""
        return parameter_names(self.model)

    @property
    def units(self) -> tuple[str, ...]:
        """Of the parameters: "pixel" or "1"."""
        return tuple("pixel" if name in PIXELS or name.startswith("spline") else "1" for name in self.names)

    @property
    def beforehand(self) -> Array:
        """Standard deviations (p,) of the parameters before anything is seen; they are then expected at 0."""
        return np.array([np.inf if unit == "pixel" else PLAIN for unit in self.units])

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

    def with_params(self, params: Array) -> Camera:
        """The same model with other numbers."""
        return replace(self, params=np.asarray(params, dtype=np.float64))

    def colmap(self) -> pycolmap.Camera:
        """The same for pycolmap, its pixel centres at 0.5."""
        params = self.params + COLMAP_CENTRE * _is_centre(self.model)
        return pycolmap.Camera(model=self.model, width=self.columns, height=self.rows, params=params)

    @cached_property
    def _theirs(self) -> pycolmap.Camera:
        """The same, kept: to be read alone."""
        return self.colmap()

    @classmethod
    def from_colmap(cls, camera: pycolmap.Camera) -> Camera:
        """The camera of one of pycolmap's."""
        model = camera.model.name
        params = np.array(camera.params, dtype=np.float64) - COLMAP_CENTRE * _is_centre(model)
        return cls(model, params, camera.width, camera.height)

    def project(self, points: Array) -> Array:
        """Where points (n, 3) of the camera's frame (x right, y down, z away) are seen, (n, 2); NaN behind it."""
        return _projected(self._theirs, np.ascontiguousarray(points))

    def rays(self, pixels: Array) -> Array:
        """Directions (x, y, 1) in which pixels (n, 2) look, (n, 3); NaN where the model has none."""
        flat = self._theirs.cam_from_img(np.ascontiguousarray(pixels + COLMAP_CENTRE))
        return np.column_stack([np.asarray(flat, dtype=np.float64)[:, :2], np.ones(len(pixels))])

    def by_params(self, points: Array) -> Array:
        """Derivative (n, 2, p) of where points (n, 3) are seen with respect to the parameters."""
        theirs, points, columns = self.colmap(), np.ascontiguousarray(points), []
        params = np.array(theirs.params)
        for i, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            if name in CENTRE:  # it moves every point as far as it is moved
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
        """Derivative (n, 2, 3) of where points (n, 3) are seen with respect to their place."""
        step = STEP_SHARE * np.linalg.norm(points, axis=1)
        theirs, columns = self._theirs, []
        for axis in np.eye(3):
            move = step[:, None] * axis
            change = _projected(theirs, points + move) - _projected(theirs, points - move)
            columns.append(change / (2 * step[:, None]))
        return np.stack(columns, axis=-1)

    def frame_grid(self, columns: int, rows: int) -> Array:
        """Places (columns * rows, 2) spread evenly over the frame, row by row, rims included."""
        x, y = np.meshgrid(np.linspace(0, self.columns - 1, columns), np.linspace(0, self.rows - 1, rows))
        return np.column_stack([x.ravel(), y.ravel()])


def simple_camera(
    model: str, focal_px: tuple[float, float], centre: tuple[float, float], size: tuple[int, int]
) -> Camera:
    """A camera without distortion.

    Parameters
    ----------
    focal_px, centre : (x, y)
    size : (columns, rows)

    Raises
    ------
    BadParameter
        If there is no such model.
    """
    names = parameter_names(model)
    known = {"f": sum(focal_px) / 2, "fx": focal_px[0], "fy": focal_px[1], "cx": centre[0], "cy": centre[1]}
    return Camera(model, np.array([known.get(name, 0.0) for name in names]), *size)


def enriched(camera: Camera, model: str) -> Camera | None:
    """The same camera by a model that can draw all that its own can, or None where the model is no such one."""
    if not any(camera.model in family and family[camera.model] <= family.get(model, -1) for family in NESTED):
        return None
    (fx, fy), known = camera.focal_px, dict(zip(camera.names, camera.params.tolist(), strict=True))
    known |= {"f": fx, "fx": fx, "fy": fy}
    known.setdefault("k1", known.get("k", 0.0))
    return Camera(
        model, np.array([known.get(name, 0.0) for name in parameter_names(model)]), camera.columns, camera.rows
    )


def _projected(theirs: pycolmap.Camera, points: Array) -> Array:
    """Where pycolmap's camera sees points (n, 3), in this project's pixels, (n, 2)."""
    return np.asarray(theirs.img_from_cam(points), dtype=np.float64) - COLMAP_CENTRE


@cache
def parameter_names(model: str) -> tuple[str, ...]:
    """The parameters of a model; raises BadParameter where there is no such model."""
    base, (nx, ny) = split_model(model)
    names = tuple(pycolmap.Camera.create_from_model_name(0, base, 1.0, 1, 1).params_info.split(", "))
    return names + tuple(f"spline_{axis}_{i}_{j}" for j in range(ny) for i in range(nx) for axis in "xy")


@cache
def split_model(model: str) -> tuple[str, tuple[int, int]]:
    """The formula of a model, and how many control points a spline over it has along x and y: (0, 0) without.

    Raises
    ------
    BadParameter
        If there is no such model.
    """
    base, spline, grid = model.partition(SPLINE)
    told = re.fullmatch("([0-9]{1,2})X([0-9]{1,2})", grid)
    nx, ny = (int(told[1]), int(told[2])) if told else (0, 0)
    if base not in (*MODELS, *OTHER_MODELS) or (spline and min(nx, ny) < FEWEST):
        known = ", ".join((*MODELS, *OTHER_MODELS))
        raise BadParameter(
            f"there is no camera model {model!r}", f"name one of {known}, or one with {SPLINE}12X9 behind it"
        )
    return base, (nx, ny)


@cache
def _is_centre(model: str) -> Array:
    """1 where a parameter is a coordinate of the principal point, (p,)."""
    return np.array([float(name in CENTRE) for name in parameter_names(model)])


def distortion(camera: Camera, pixels: Array) -> Array:
    """How far places of the frame (n, 2) lie from where a pinhole of the same focal length has them, in pixels."""
    pinhole = camera.rays(pixels)[:, :2] * camera.focal_px + camera.centre
    return np.asarray(pixels - pinhole)
