"""The poses of the cameras on a rig by the first, from the results of their geometries."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from procedures.geometry.rig import CONVENTION, RigPoses, estimate_rig
from procedures.numbers import BASELINE
from procedures.outcome import BadInput, BadParameter
from station.calibration.stored_cameras import read_rig_camera
from station.common.progress import Progress
from station.procedure.base import Inputs, Procedure, Settings, plane_result, setting, to_record, upper_plane
from station.results.measurement import Measurement
from station.results.record_head import RecordHead
from station.results.result_files import RECORD, npy


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

    def measured(self, paths: Sequence[Path], settings: RigSettings, progress: Progress) -> Measurement:
        if len(paths) < 2:
            raise BadParameter("a rig has two cameras or more; got one result", "name the results of all its cameras")
        cameras = []
        for path in paths:
            cameras.append(read_rig_camera(path, upper_plane(settings.plane)))
            progress(f"read {path}")
        hashes = [camera.file.sha256 for camera in cameras]
        for second, sha256 in enumerate(hashes):
            if (first := hashes.index(sha256)) < second:
                reason = f"{paths[first]} and {paths[second]} are one geometry"
                raise BadInput(reason, "name the results of the rig's different cameras")
        outcome = estimate_rig(
            [camera.camera for camera in cameras], None if settings.depth_m is None else 1000 * settings.depth_m
        )
        head = RecordHead(self.name, tuple(camera.file for camera in cameras), to_record(settings))
        rig = outcome.value
        return Measurement(
            self.schema, head, (plane_result(self.name, outcome, None if rig is None else _entries(rig, paths)),),
            results_key=self.results_key,
            files={} if rig is None else {"rig_covariance.npy": npy(rig.covariance)},
        )  # fmt: skip


def _entries(rig: RigPoses, paths: Sequence[Path]) -> dict[str, Any]:
    """Entries of the record: the second camera's pose, and those of all further ones."""
    baseline = rig.numbers()[BASELINE]
    scale = rig.scale * baseline.value
    budget = {"points": max(baseline.uncertainty**2 - scale**2, 0.0) ** 0.5, "scale": scale}
    cameras = [
        {"result": str(path), "R": pose.R.tolist(), "t_mm": pose.t.tolist(),
         **{name: asdict(number) for name, number in rig.numbers_of(i).items()}}
        for i, (path, pose) in enumerate(zip(paths[1:], rig.poses, strict=True))
    ]  # fmt: skip
    return {
        "R": cameras[0]["R"], "t_mm": cameras[0]["t_mm"], "charts": list(rig.charts), "convention": CONVENTION,
        "cameras": cameras, "diagnostics": {"misfit": rig.misfit, "chance": rig.chance},
        BASELINE: asdict(baseline) | {"budget": budget},
        **({} if rig.next_view is None else {"next_view": asdict(rig.next_view)}),
    }  # fmt: skip
