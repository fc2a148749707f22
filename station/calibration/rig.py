"""A camera of a rig with its views of the chart, read from its result of station geometry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procedures.geometry.rig import RigCamera
from procedures.geometry.views import ChartView, Pose
from procedures.outcome import BadInput
from procedures.reading.arrays import checked_array, checked_number, read_npy
from station.calibration.exports.geometry import read_camera
from station.calibration.geometry_files import NODES, POINTS
from station.calibration.stored_results import StoredRecord, stored_record
from station.results.geometry_planes import plane_entry, table_prefix
from station.results.record_head import InputFile

_GIVE = "name the folder that station geometry wrote"


@dataclass(frozen=True, eq=False)
class StoredRigCamera:
    """A camera of a rig, with the file that it comes from."""

    file: InputFile
    camera: RigCamera


def read_rig_camera(result: Path, plane: str | None = None) -> StoredRigCamera:
    """The camera of a result of station geometry, a folder or its record; of green, or the first plane, by default.

    Raises BadInput if there is no such result, or it has no views; BadParameter if it does not have the plane.
    """
    with stored_record(result, "geometry", _GIVE) as stored:
        planes = stored.data["planes"]
        name, entry = plane_entry(planes, plane, stored.path)
        if "views" not in entry:
            raise BadInput(f"{stored.path} has no poses: {entry['reason']}", entry["remedy"])
        prefix = table_prefix(name, len(planes))
        nodes = _table(stored, prefix + NODES, "plan of the chart", 3)
        poses = tuple(_pose(one) for one in entry["views"])
        camera = RigCamera(
            read_camera(result, plane).camera, _views(stored, prefix, entry["views"], len(nodes)), poses, nodes,
            checked_number(stored.data.get("parameters", {}).get("scale_uncertainty", 0.0),
                           f"the scale's uncertainty in {stored.path}", 0.0),
        )  # fmt: skip
        return StoredRigCamera(InputFile(str(stored.path), stored.sha256), camera)


def _table(stored: StoredRecord, name: str, what: str, columns: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    path = stored.path.parent / name
    if not path.is_file():
        raise BadInput(f"a rig needs the {what} in {path}, which is missing", "calibrate the camera again")
    return checked_array(read_npy(path, what, _GIVE), f"the {what} {path}", (None, columns), remedy=_GIVE)


def _views(stored: StoredRecord, prefix: str, entries: list[Mapping[str, Any]], nodes: int) -> tuple[ChartView, ...]:
    """The views with their points: columns view, node, x, y, variance of x, covariance, variance of y."""
    table = _table(stored, prefix + POINTS, "points", 7)
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
