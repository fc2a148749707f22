"""The sharp picture and the depth map from two or more photographs blurred by depth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from station.common.progress import Progress
from station.procedure.base import Inputs, Procedure
from station.procedure.restore_settings import RestoreSettings
from station.results.measurement import RESTORATION, Measurement

if TYPE_CHECKING:
    from procedures.restoration.joint.result import Restoration


class Restore(Procedure[RestoreSettings]):
    """Photographs of one scene that differ in blur."""

    name = "restore"
    title = "sharp picture and depth"
    help = """Restore the sharp picture and the depth map from IMAGES, two or more photographs of one scene.

    --plane all restores RAW photographs in colour, on the sensor's grid."""
    inputs = Inputs.SCENE
    Settings = RestoreSettings
    schema = RESTORATION
    results_key = "result"
    drawn_by = "restoration_page:restoration_page"
    method = "joint estimation of picture and depth by regularized least squares over the blur's masks"

    def steps(self, paths: Sequence[Path]) -> int:
        return 100

    def files(self, paths: Sequence[Path], settings: RestoreSettings) -> list[Path]:
        return settings.of(paths).files

    def measured(self, paths: Sequence[Path], settings: RestoreSettings, progress: Progress) -> Measurement:
        from station.procedure.restoring import restored  # here: mathematics, slow to load

        return restored(self.name, paths, settings, progress)

    def lines(self, measurement: Measurement) -> list[str]:
        restoration: Restoration | None = measurement.result and measurement.result.outcome.value
        if restoration is None or restoration.ground_truth is None:
            return []
        truth = restoration.ground_truth
        before = ", ".join(f"{db:.1f}" for db in truth.before_db)
        return [
            f"compared with the ground truth {truth.psnr_db:.1f} dB, the photographs {before} dB; "
            f"error {truth.error:.2%} of white, estimated {truth.stated_error:.2%}"
        ]
