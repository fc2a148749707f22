"""Cameras of `station geometry`, read back from its results: the model alone, or with its views of the chart."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procedures.geometry import stereographic
from procedures.geometry.cameras import STEREOGRAPHIC, CameraModel, split_model
from procedures.geometry.rig import RigCamera
from procedures.geometry.spline_camera import ROUGH_PX, SplineCamera
from procedures.geometry.views import ChartView, Pose
from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, BadParameter
from procedures.reading.arrays import LONGEST, SMALLEST, checked_array, checked_number, read_npy
from station.calibration.geometry_files import NODES, POINTS
from station.calibration.stored_results import StoredRecord, plane_entry, stored_record, table_prefix
from station.results.record_head import InputFile

GIVE = "name the folder that `station geometry` wrote"


@dataclass(frozen=True, eq=False)
class StoredCamera:
    """The camera of a result.

    record : the record that it was read from
    plane : str
    """

    camera: CameraModel
    region: Array
    source: str
    record: Path | None = None
    plane: str = ""


def read_camera(result: Path, plane: str | None = None) -> StoredCamera:
    """The camera of a result of station geometry, a folder or its record; of green, or the first plane, by default.
    Raises BadInput if there is no such result, or it has no camera; BadParameter if it does not have the plane."""
    with stored_record(result, "geometry", GIVE) as stored:
        name, entry = plane_entry(stored.data["planes"], plane, stored.path)
        if "camera" not in entry:
            raise BadInput(f"{stored.path} has no camera: {entry['reason']}", entry["remedy"])
        region = checked_array(entry["region"], f"the region of plane {name}", (None, 2), remedy=GIVE)
        return StoredCamera(_camera(**entry["camera"]), region, f"station geometry, plane {name}", stored.path, name)


def _camera(
    model: str, params: list[float], columns: int, rows: int, roughness_px: float = ROUGH_PX, **_: object
) -> CameraModel:
    """Raises ValueError where it is invalid."""
    try:
        spline = any(split_model(model)[1])
    except BadParameter as error:
        raise ValueError(f"there is no camera model {model!r}") from error
    what = f"the parameters of a camera {model}"
    values = checked_array(params, what, (None,), remedy=GIVE)
    camera = CameraModel(model, values, columns, rows)
    if model.startswith(STEREOGRAPHIC) and len(values) == len(camera.names) - 2:  # of versions without p3 and p4
        values = np.insert(values, stereographic.NAMES.index("p3"), [0.0, 0.0])
        camera = camera.with_params(values)
    if spline:
        rough = checked_number(roughness_px, "the roughness of a spline", SMALLEST)
        camera = SplineCamera(model, values, columns, rows, rough)
    checked_array(camera.params, what, (len(camera.names),), remedy=GIVE)
    checked_array(camera.focal_px, "the focal length of a camera", (2,), low=SMALLEST, remedy=GIVE)
    if not all(type(side) is int and 0 < side <= LONGEST for side in (columns, rows)):
        raise ValueError(f"a frame must have 1 to {LONGEST} pixels each way")
    return camera


@dataclass(frozen=True, eq=False)
class StoredRigCamera:
    """A camera of a rig, with the file that it comes from."""

    file: InputFile
    camera: RigCamera


def read_rig_camera(result: Path, plane: str | None = None) -> StoredRigCamera:
    """The camera of a result of station geometry, a folder or its record; of green, or the first plane, by default.
    Raises BadInput if there is no such result, or it has no views; BadParameter if it does not have the plane."""
    with stored_record(result, "geometry", GIVE) as stored:
        planes = stored.data["planes"]
        name, entry = plane_entry(planes, plane, stored.path)
        if "views" not in entry:
            raise BadInput(f"{stored.path} has no poses: {entry['reason']}", entry["remedy"])
        prefix = table_prefix(name, len(planes))
        nodes = plane_table(stored, prefix + NODES, "plan of the chart", 3)
        poses = tuple(_pose(one) for one in entry["views"])
        camera = RigCamera(
            read_camera(result, plane).camera, _views(stored, prefix, entry["views"], len(nodes)), poses, nodes,
            checked_number(stored.data.get("parameters", {}).get("scale_uncertainty", 0.0),
                           f"the scale's uncertainty in {stored.path}", 0.0),
        )  # fmt: skip
        return StoredRigCamera(InputFile(str(stored.path), stored.sha256), camera)


def plane_table(stored: StoredRecord, name: str, what: str, columns: int) -> Array:
    """A table (n, columns) beside a record. Raises BadInput where it is missing."""
    path = stored.path.parent / name
    if not path.is_file():
        raise BadInput(f"the {what} must be in {path}, which is missing", "calibrate the camera again")
    return checked_array(read_npy(path, what, GIVE), f"the {what} {path}", (None, columns), remedy=GIVE)


def _views(stored: StoredRecord, prefix: str, entries: list[Mapping[str, Any]], nodes: int) -> tuple[ChartView, ...]:
    """The views with their points: columns view, node, x, y, variance of x, covariance, variance of y."""
    table = plane_table(stored, prefix + POINTS, "points", 7)
    index = table[:, :2].astype(np.int64)
    if index.min(initial=0) < 0 or index[:, 1].max(initial=0) >= nodes:
        raise ValueError(f"the nodes of the points must be below {nodes}")
    views = []
    for i, entry in enumerate(entries):
        own = table[index[:, 0] == i]
        covariance = own[:, [4, 5, 5, 6]].reshape(-1, 2, 2)
        if not len(own) or np.linalg.eigvalsh(covariance).min() <= 0:
            raise ValueError(f"every view must have points with a positive definite covariance; view {i} does not")
        views.append(ChartView(str(entry["source"]), own[:, 1].astype(np.int64), own[:, 2:4], covariance))
    return tuple(views)


def _pose(entry: Mapping[str, Any]) -> Pose:
    R, t = (checked_array(entry[name], f"`{name}` of a pose", shape) for name, shape in (("R", (3, 3)), ("t_mm", (3,))))
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-6):
        raise ValueError("`R` of a pose must be a rotation")
    return Pose(R, t)
