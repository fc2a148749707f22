"""The charts that a camera of a rig saw, read from the result of its geometry."""

from __future__ import annotations

import hashlib
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
from procedures.reading.guard import decoding, read_file
from procedures.reading.text import parse_json
from station.results.geometry_planes import plane_entry, table_prefix
from station.results.record_head import InputFile
from station.results.result_files import RECORD

JOINT = "joint_covariance.npy"
_GIVE = "name the folder that station geometry wrote"


@dataclass(frozen=True, eq=False)
class RigCamera:
    """One camera's charts, as its geometry's result has them."""

    file: InputFile
    charts: PosedCharts


def read_rig_camera(result: Path, plane: str | None = None) -> RigCamera:
    """The charts of a geometry's result, a folder or its record.

    Parameters
    ----------
    plane : str or None
        None for green, or the first there is.

    Raises
    ------
    BadInput
        If there is no such result, or it has no poses.
    BadParameter
        If it does not tell of the plane.
    """
    record = result / RECORD if result.is_dir() else result
    data = read_file(record, "geometry's result")
    told = parse_json(data, str(record), _GIVE)
    with decoding(str(record), "a geometry's result", _GIVE):
        if told.get("procedure") != "geometry":
            kind = told.get("procedure", "nothing known")
            raise BadInput(f"a rig is made of geometries; {record} is of {kind}", _GIVE)
        name, entry = plane_entry(told["planes"], plane, record)
        if "views" not in entry:
            raise BadInput(f"{record} holds no poses: {entry['reason']}", entry["remedy"])
        views = entry["views"]
        table = table_prefix(name, len(told["planes"])) + JOINT
        covariance = read_npy(record.parent / table, "covariance", _GIVE)
        joint = checked_array(covariance, f"the covariance {record.parent / table}", ("n", "n"), remedy=_GIVE)
        size = POSE * len(views)
        if len(joint) < size:
            raise ValueError(f"the covariance of {len(views)} poses has {size} rows or more; got {len(joint)}")
        known = {**told.get("parameters", {}), **entry.get("chart", {})}  # earlier results tell it of a cell alone
        charts = PosedCharts(
            tuple(str(one["source"]) for one in views), tuple(_pose(one) for one in views), joint[-size:, -size:],
            checked_number(known.get("scale_uncertainty", 0.0), f"the scale's uncertainty in {record}", 0.0),
        )  # fmt: skip
        return RigCamera(InputFile(str(record), hashlib.sha256(data).hexdigest()), charts)


def _pose(told: Mapping[str, Any]) -> Pose:
    R, t = (checked_array(told[name], f"`{name}` of a pose", shape) for name, shape in (("R", (3, 3)), ("t_mm", (3,))))
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-6):
        raise ValueError("`R` of a pose must be a rotation")
    return Pose(R, t)
