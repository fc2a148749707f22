"""The charts that a camera of a rig photographed, read from its result of station geometry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procedures.geometry.adjustment import POSE
from procedures.geometry.rig import PosedCharts
from procedures.geometry.views import Pose
from procedures.outcome import BadInput
from procedures.reading.arrays import checked_array, checked_number, read_npy
from station.calibration.stored_results import stored_record
from station.results.geometry_planes import plane_entry, table_prefix
from station.results.record_head import InputFile

JOINT = "joint_covariance.npy"
_GIVE = "name the folder that station geometry wrote"


@dataclass(frozen=True, eq=False)
class RigCamera:
    """The charts of one camera, with the file that they come from."""

    file: InputFile
    charts: PosedCharts


def read_rig_camera(result: Path, plane: str | None = None) -> RigCamera:
    """The charts of a result of station geometry, a folder or its record; of green, or the first plane, by default.

    Raises
    ------
    BadInput
        If there is no such result, or it has no poses.
    BadParameter
        If it does not have the plane.
    """
    with stored_record(result, "geometry", _GIVE) as stored:
        planes = stored.data["planes"]
        name, entry = plane_entry(planes, plane, stored.path)
        if "views" not in entry:
            raise BadInput(f"{stored.path} has no poses: {entry['reason']}", entry["remedy"])
        views = entry["views"]
        table = stored.path.parent / (table_prefix(name, len(planes)) + JOINT)
        joint = checked_array(read_npy(table, "covariance", _GIVE), f"the covariance {table}", ("n", "n"), remedy=_GIVE)
        size = POSE * len(views)
        if len(joint) < size:
            raise ValueError(f"the covariance of {len(views)} poses has {size} rows or more; got {len(joint)}")
        known = {**stored.data.get("parameters", {}), **entry.get("chart", {})}  # earlier results have that of a cell
        charts = PosedCharts(
            tuple(str(one["source"]) for one in views), tuple(_pose(one) for one in views), joint[-size:, -size:],
            checked_number(known.get("scale_uncertainty", 0.0), f"the scale's uncertainty in {stored.path}", 0.0),
        )  # fmt: skip
        return RigCamera(InputFile(str(stored.path), stored.sha256), charts)


def _pose(entry: Mapping[str, Any]) -> Pose:
    R, t = (checked_array(entry[name], f"`{name}` of a pose", shape) for name, shape in (("R", (3, 3)), ("t_mm", (3,))))
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-6):
        raise ValueError("`R` of a pose must be a rotation")
    return Pose(R, t)
