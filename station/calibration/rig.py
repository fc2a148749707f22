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
from procedures.reading.arrays import read_npy
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
        joint = read_npy(record.parent / table, "covariance", _GIVE).astype(np.float64)
        size = POSE * len(views)
        if joint.ndim != 2 or joint.shape[0] != joint.shape[1] or len(joint) < size or not np.isfinite(joint).all():
            raise ValueError(f"the covariance of {len(views)} poses is a square of {size} numbers and more")
        known = {**told.get("parameters", {}), **entry.get("chart", {})}  # earlier results tell it of a cell alone
        charts = PosedCharts(
            tuple(str(one["source"]) for one in views), tuple(_pose(one) for one in views), joint[-size:, -size:],
            float(known.get("scale_uncertainty", 0.0)),
        )  # fmt: skip
        return RigCamera(InputFile(str(record), hashlib.sha256(data).hexdigest()), charts)


def _pose(told: Mapping[str, Any]) -> Pose:
    R, t = (np.array(told[name], dtype=np.float64) for name in ("R", "t_mm"))
    whole = R.shape == (3, 3) and t.shape == (3,) and np.isfinite([*R.ravel(), *t]).all()
    if not whole or not np.allclose(R @ R.T, np.eye(3), atol=1e-6):
        raise ValueError("a pose is a rotation and three numbers")
    return Pose(R, t)
