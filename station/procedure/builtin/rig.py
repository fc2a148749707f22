"""The poses of the cameras on a rig by the first, from the results of their geometries."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from procedures.geometry.rig import CONVENTION, RigCamera, RigPoses, estimate_rig
from procedures.geometry.views import ChartView, Pose
from procedures.outcome import BadInput, BadParameter
from procedures.reading.arrays import checked_array, checked_number, read_npy
from station.calibration.exports.geometry import read_camera
from station.calibration.geometry_files import NODES, POINTS
from station.calibration.stored_results import StoredRecord, plane_entry, stored_record, table_prefix
from station.common.progress import Progress, silent
from station.procedure.base import Inputs, Procedure, Settings, plane_result, setting, to_record, upper_plane
from station.results.measurement import Measurement
from station.results.record_head import InputFile, RecordHead
from station.results.result_files import RECORD, npy
from station.results.terms import USUAL, Terms


class RigSettings(Settings, frozen=True, kw_only=True):
    """Which plane."""

    plane: Annotated[str | None, setting("Of all.  [default: G1, or the first there is]")] = None
    depth_m: Annotated[float, setting("Propose the next view, for the depth at this distance.", least=0.01)] | None = (
        None
    )


class Rig(Procedure[RigSettings]):
    """Geometries of one chart that the cameras of a rig saw."""

    name = "rig"
    title = "poses of a rig's cameras by its first"
    help = """Measure the poses of the cameras of a rig by its FIRST: results of station geometry, of one chart seen by
    two or more cameras at once.

    Photographs that were taken at one time have one name in all; where none has, they belong together in their
    order."""
    inputs = Inputs.RESULTS
    Settings = RigSettings
    suffixes = frozenset((RECORD,))
    endings = {"first": "_left", "second": "_right"}  # noqa: RUF012  (a constant of the class)
    results_key = "rig"
    method = "one adjustment of all cameras and the chart that they share"

    def measure(
        self, paths: Sequence[Path], settings: RigSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        """The poses of all cameras by the first."""
        if len(paths) < 2:
            raise BadParameter("a rig has two cameras or more; got one result", "name the results of all its cameras")
        cameras = []
        for path in paths:
            cameras.append(read_rig_camera(path, upper_plane(settings.plane)))
            progress(f"read {path}")
        hashes = [one.file.sha256 for one in cameras]
        for second, sha256 in enumerate(hashes):
            if (first := hashes.index(sha256)) < second:
                reason = f"{paths[first]} and {paths[second]} are one geometry"
                raise BadInput(reason, "name the results of the rig's different cameras")
        outcome = estimate_rig(
            [one.camera for one in cameras], None if settings.depth_m is None else 1000 * settings.depth_m
        )
        head = RecordHead(self.name, tuple(one.file for one in cameras), to_record(settings))
        rig = outcome.value
        return Measurement(
            self.schema, head, (plane_result(self.name, outcome, None if rig is None else _entries(rig, paths)),),
            results_key=self.results_key,
            files={} if rig is None else {"rig_covariance.npy": npy(rig.covariance)},
        ).compared(terms)  # fmt: skip


def _entries(rig: RigPoses, paths: Sequence[Path]) -> dict[str, Any]:
    """Entries of the record: the second camera's pose, and those of all further ones."""
    cameras = [
        {"result": str(path), "R": pose.R.tolist(), "t_mm": pose.t.tolist(),
         **{name: asdict(number) for name, number in rig.numbers_of(i).items()}}
        for i, (path, pose) in enumerate(zip(paths[1:], rig.poses, strict=True))
    ]  # fmt: skip
    return {
        "R": cameras[0]["R"], "t_mm": cameras[0]["t_mm"], "charts": list(rig.charts), "convention": CONVENTION,
        "cameras": cameras, "diagnostics": {"misfit": rig.misfit, "chance": rig.chance},
        **({} if rig.next_view is None else {"next_view": asdict(rig.next_view)}),
    }  # fmt: skip


PROCEDURE = Rig()


# --- a camera of a rig with its views of the chart, read from its result of station geometry ---

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
