"""The pose of one camera on a rig by the other, from the results of their geometries."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from procedures.geometry.rig import estimate_rig
from procedures.outcome import BadInput
from station.calibration.rig import read_rig_camera
from station.common.progress import Progress, silent
from station.procedure.base import Inputs, Procedure, plane_result, upper_plane
from station.procedure.settings import Settings, setting, to_record
from station.results.measurement import Measurement
from station.results.record_head import RecordHead
from station.results.result_files import RECORD, npy
from station.results.terms import USUAL, Terms


class RigSettings(Settings, frozen=True, kw_only=True):
    """Which plane."""

    plane: Annotated[str | None, setting("Of both.  [default: G1, or the first there is]")] = None


class Rig(Procedure[RigSettings]):
    """Two geometries of one chart that both cameras saw."""

    name = "rig"
    title = "pose of a rig's second camera by its first"
    help = """Measure the pose of a rig's SECOND camera by its FIRST: results of station geometry, of one chart seen by
    both.

    Photographs that were taken at one time have one name in both; where none has, they belong together in their
    order."""
    inputs = Inputs.RESULTS
    Settings = RigSettings
    suffixes = frozenset((RECORD,))
    endings = {"first": "_left", "second": "_right"}  # noqa: RUF012  (a constant of the class)
    results_key = "rig"
    method = "mean of the relative poses of charts that both cameras saw, weighted by their covariances"

    def measure(
        self, paths: Sequence[Path], settings: RigSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        """The pose of the second camera by the first."""
        cameras = []
        for path in paths:
            cameras.append(read_rig_camera(path, upper_plane(settings.plane)))
            progress(f"read {path}")
        first, second = cameras
        if first.file.sha256 == second.file.sha256:
            raise BadInput(f"{paths[0]} and {paths[1]} are one geometry", "name the results of the rig's two cameras")
        outcome = estimate_rig(first.charts, second.charts)
        estimate = outcome.value
        details = {} if estimate is None else {
            "R": estimate.pose.R.tolist(), "t_mm": estimate.pose.t.tolist(), "charts": list(estimate.charts),
            "diagnostics": {"misfit": estimate.misfit, "chance": estimate.chance},
        }  # fmt: skip
        head = RecordHead(self.name, (first.file, second.file), to_record(settings))
        return Measurement(
            self.schema, head, (plane_result(self.name, outcome, details),), results_key=self.results_key,
            files={} if estimate is None else {"rig_covariance.npy": npy(estimate.covariance)},
        ).compared(terms)  # fmt: skip


PROCEDURE = Rig()
