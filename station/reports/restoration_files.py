"""Files of a restoration: picture, depth, their pictures for people, and the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.facts import facts_as
from procedures.numbers import W_GREATEST, W_LEAST, W_MEDIAN
from procedures.outcome import Outcome, Quantity
from procedures.raw import RawFrame
from procedures.restoration.facts import RestorationFacts
from procedures.restoration.joint.result import GroundTruth, Restoration
from procedures.restoration.known_blur import apart, planes_of, rig_poses, stacked
from procedures.restoration.metres import Distances
from station.calibration.restoration.restorations import Restored
from station.common.versions import software
from station.drawing.depth_pictures import coloured, encoded, levels, picture
from station.drawing.linear_pictures import described_tiff, float_tiff
from station.results.exports import kernel_fits
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, verdict_entry
from station.results.restored import RESTORATION
from station.results.result_files import ResultFolder, npy, write_record

SHARP_WORDS = "restored picture, linear, 1 = white, first row uppermost; calibration-station"
"""The picture's description."""
STD_WORDS = "standard deviation of the restored picture, 1 = white, first row uppermost; calibration-station"
KERNEL_WORDS = "kernel of photograph {}, one sample a pixel, sum 1, first row uppermost; calibration-station"
DIFFERENCE_WORDS = "restored picture less the ground truth, 1 = white, 0 where it shows nothing; calibration-station"
Array = npt.NDArray[np.floating[Any]]


def restoration_result(outcome: Outcome[Restoration], frames: Sequence[RawFrame]) -> PlaneResult:
    """A restoration as the result of its planes together: the median of its blur, and what it says of itself."""
    name, found = "+".join(frames[0].planes), outcome.value
    if found is None:
        return PlaneResult.of_outcome(name, outcome)
    per, unit = found.unit.per_pixel, found.unit.name
    spread = float(np.median(found.w_std)) * per
    method = "median over the map; uncertainty: the median of each place's least"
    numbers = {W_MEDIAN: Quantity(float(np.median(found.w)) * per, unit, spread, method, found.w.size)}
    return PlaneResult.of_outcome(
        name, outcome, numbers=numbers,
        values={W_LEAST: float(found.w.min()) * per, W_GREATEST: float(found.w.max()) * per,
                **asdict(found.diagnostics)},
        found=found,
    )  # fmt: skip


def write_outcome(
    folder: ResultFolder, found: Restored, head: RecordHead, photographs: Sequence[Array], *, page: bool = True
) -> str:
    """The files of a restoration, with its page or without, or the record of its refusal; returns the record's text."""
    if found.outcome.value is None:
        return write_refusal(folder, found.outcome, head)
    if not page:
        return write_restoration(folder, found, head, None)
    from station.reports.restoration_page import restoration_page  # here: it draws, which is slow to load

    return write_restoration(folder, found, head, restoration_page(found.outcome, photographs, head, found.distances))


def write_restoration(folder: ResultFolder, restored: Restored, head: RecordHead, page: bytes | None) -> str:
    """Stage and publish every file; returns the record's text.

    page : the report, None where none is wanted
    """
    outcome, distances = restored.outcome, restored.distances
    found = outcome.value
    if found is None:
        raise ValueError("a restoration without a value has no files")
    unit = found.unit
    _write_pictures(folder, found)
    if distances is not None:
        folder.write("distance.npy", npy(distances.metres, np.float32))
        folder.write("distance_std.npy", npy(distances.std, np.float32))
    if page is not None:
        folder.write("report.html", page)
    record = {
        "schema": RESTORATION,
        **head.told(),
        **verdict_entry(outcome),
        "w": {
            "least": float(found.w.min()) * unit.per_pixel,
            "greatest": float(found.w.max()) * unit.per_pixel,
            "unit": unit.name,
            "per_pixel": unit.per_pixel,
        },
        **({} if found.kernels is None else {"kernels": {"count": len(found.kernels), "samples_per_pixel": 1}}),
        **({} if found.shapes is None else {"shapes": {"count": len(found.shapes)}}),
        **({} if distances is None else {"distance": _told_distances(distances)}),
        **({} if found.ground_truth is None else {"ground_truth": _told_ground_truth(found.ground_truth)}),
        "shift": {"x_y": found.shifts.tolist(), "unit": "pixel"},
        "turn": {"value": np.rad2deg(found.turns).tolist(), "unit": "degree"},
        "zoom": found.zooms.tolist(),
        "light": found.light.tolist(),
        "diagnostics": asdict(found.diagnostics),
        "iterations": [
            {"n": r.n, "what": r.what, "cost": r.cost, "residual": r.residual, "change": r.change, "seconds": r.seconds}
            for r in found.history
        ],
        "software": software(),
    }
    return write_record(folder, record)


def _write_pictures(folder: ResultFolder, found: Restoration) -> None:
    """Picture, depth, what is said of both, and the blur that was found."""
    folder.write("sharp.tiff", described_tiff(encoded(".tiff", picture(found.sharp).astype(np.float32)), SHARP_WORDS))
    folder.write("sharp_std.tiff", described_tiff(float_tiff(found.sharp_std), STD_WORDS))
    folder.write("sharp.png", encoded(".png", levels(picture(found.sharp), 0, 1)))
    folder.write("w.npy", npy(found.w * found.unit.per_pixel, np.float32))
    folder.write("w_std.npy", npy(found.w_std * found.unit.per_pixel, np.float32))
    if found.moved.any():
        folder.write("moved.npy", npy(found.moved, np.uint8))
    if found.occlusion.any():
        folder.write("occlusion.npy", npy(found.occlusion, np.uint8))
    folder.write("depth.png", encoded(".png", coloured(found.w)))
    for n, kernel in enumerate(() if found.kernels is None else found.kernels, start=1):
        folder.write(f"kernel_{n}.npy", npy(kernel))
        folder.write(f"kernel_{n}.fits", kernel_fits(kernel, n, software()["version"]))
        folder.write(f"kernel_{n}.tiff", described_tiff(float_tiff(kernel), KERNEL_WORDS.format(n)))
    for n, shape in enumerate(() if found.shapes is None else found.shapes, start=1):
        folder.write(f"shape_{n}.npy", npy(shape, np.float32))
    if found.ground_truth is not None:
        off = picture(np.nan_to_num(found.ground_truth.difference))
        folder.write("difference.tiff", described_tiff(float_tiff(off), DIFFERENCE_WORDS))


def _told_ground_truth(found: GroundTruth) -> dict[str, Any]:
    """What the record says of a ground truth; what could not be laid on it is None."""
    told = {one.name: getattr(found, one.name) for one in fields(found) if one.name != "difference"}
    before = [one if np.isfinite(one) else None for one in found.before_db]
    return {**told, "before_db": before, "matrix": found.matrix.tolist()}


def _told_distances(found: Distances) -> dict[str, Any]:
    """What the record says of depth in metres; numbers over the frame are None where none is told."""
    any_told = found.told > 0
    return {
        "least": float(np.nanmin(found.metres)) if any_told else None,
        "greatest": float(np.nanmax(found.metres)) if any_told else None,
        "median_std": float(np.nanmedian(found.std)) if any_told else None,
        "median_common_std": float(np.nanmedian(found.common)) if any_told else None,
        "unit": "m",
        "told": found.told,
        "side": found.side,
    }


def write_refusal(folder: ResultFolder, outcome: Outcome[Restoration], head: RecordHead) -> str:
    """Publish the record of a refusal, which has no other files; returns its text."""
    return write_record(
        folder, {"schema": RESTORATION, **head.told(), **verdict_entry(outcome), "software": software()}
    )


def write_plane(folder: ResultFolder, result: PlaneResult, frames: Sequence[RawFrame], head: RecordHead) -> str:
    """The result of a guided restoration: the files of `write_restoration`, or the record of its refusal."""
    from station.calibration.restoration.inputs import imu_table, poses_table

    found: Restoration | None = result.found
    outcome = result.outcome(found)
    if found is None:
        return write_refusal(folder, outcome, head)
    told = facts_as(RestorationFacts, head.parameters)
    blurred, _ = apart(frames, told)
    for n, frame in enumerate(blurred, start=1):
        if frame.felt is not None:
            folder.write(f"imu_{n}.csv", imu_table(frame.felt))
        poses, exposure_s = rig_poses(frame), frame.exposure.exposure_s
        if frame.carried is not None and poses is not None and exposure_s is not None:
            folder.write(f"poses_{n}.csv", poses_table(poses, exposure_s))
    timeless = replace(found, history=tuple(replace(r, seconds=0.0) for r in found.history))
    outcome = replace(outcome, value=timeless)  # the files are the same whenever they are computed
    photographs = [stacked(planes_of(frame, told)) for frame in blurred]
    return write_outcome(folder, Restored(outcome, {}), head, photographs)
