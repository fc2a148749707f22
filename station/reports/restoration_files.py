"""Files of a restoration: picture, depth, previews, and the record."""

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
from procedures.restoration.known_blur import planes_of, rig_poses, split_ground_truth, stacked
from procedures.restoration.metres import Distances
from station.calibration.restoration.restorations import Restored
from station.common.versions import software
from station.drawing.pictures import described_tiff, encoded, false_colours, float_tiff, levels, picture
from station.results.exports import kernel_fits
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, verdict_entry
from station.results.restored import RESTORATION
from station.results.result_files import ResultFolder, npy, write_record

SHARP_WORDS = "restored picture, linear, 1 = white, first row uppermost; calibration-station"
"""Description in the picture's file."""
STD_WORDS = "standard deviation of the restored picture, 1 = white, first row uppermost; calibration-station"
KERNEL_WORDS = "kernel of photograph {}, one sample a pixel, sum 1, first row uppermost; calibration-station"
DIFFERENCE_WORDS = "restored picture less the ground truth, 1 = white, 0 where not compared; calibration-station"
Array = npt.NDArray[np.floating[Any]]


def restoration_result(outcome: Outcome[Restoration], frames: Sequence[RawFrame]) -> PlaneResult:
    """A restoration as the result of its planes together: the median of its blur, and its diagnostics."""
    name, restoration = "+".join(frames[0].planes), outcome.value
    if restoration is None:
        return PlaneResult.of_outcome(name, outcome)
    per, unit = restoration.unit.per_pixel, restoration.unit.name
    spread = float(np.median(restoration.w_std)) * per
    method = "median over the map; uncertainty: the median of each place's least"
    numbers = {W_MEDIAN: Quantity(float(np.median(restoration.w)) * per, unit, spread, method, restoration.w.size)}
    return PlaneResult.of_outcome(
        name, outcome, numbers=numbers,
        values={W_LEAST: float(restoration.w.min()) * per, W_GREATEST: float(restoration.w.max()) * per,
                **asdict(restoration.diagnostics)},
        found=restoration,
    )  # fmt: skip


def write_outcome(
    folder: ResultFolder, restoration: Restored, head: RecordHead, photographs: Sequence[Array], *, page: bool = True
) -> str:
    """Write the files of a restoration, with or without its page, or the record of its refusal; returns its text."""
    if restoration.outcome.value is None:
        return write_refusal(folder, restoration.outcome, head)
    if not page:
        return write_restoration(folder, restoration, head, None)
    from station.reports.restoration_page import restoration_page  # here: it draws, which is slow to load

    return write_restoration(
        folder, restoration, head, restoration_page(restoration.outcome, photographs, head, restoration.distances)
    )


def write_restoration(folder: ResultFolder, restored: Restored, head: RecordHead, page: bytes | None) -> str:
    """Stage and publish all files; returns the record's text.

    page : the report, None for none
    """
    outcome, distances = restored.outcome, restored.distances
    restoration = outcome.value
    if restoration is None:
        raise ValueError("a restoration without a value has no files")
    unit = restoration.unit
    _write_pictures(folder, restoration)
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
            "least": float(restoration.w.min()) * unit.per_pixel,
            "greatest": float(restoration.w.max()) * unit.per_pixel,
            "unit": unit.name,
            "per_pixel": unit.per_pixel,
        },
        **(
            {}
            if restoration.kernels is None
            else {"kernels": {"count": len(restoration.kernels), "samples_per_pixel": 1}}
        ),
        **({} if restoration.shapes is None else {"shapes": {"count": len(restoration.shapes)}}),
        **({} if distances is None else {"distance": _distance_entries(distances)}),
        **({} if restoration.ground_truth is None else {"ground_truth": _truth_entries(restoration.ground_truth)}),
        "shift": {"x_y": restoration.shifts.tolist(), "unit": "pixel"},
        "turn": {"value": np.rad2deg(restoration.turns).tolist(), "unit": "degree"},
        "zoom": restoration.zooms.tolist(),
        "light": restoration.light.tolist(),
        "diagnostics": asdict(restoration.diagnostics),
        "iterations": [
            {"n": r.n, "what": r.what, "cost": r.cost, "residual": r.residual, "change": r.change, "seconds": r.seconds}
            for r in restoration.history
        ],
        "software": software(),
    }
    return write_record(folder, record)


def _write_pictures(folder: ResultFolder, restoration: Restoration) -> None:
    folder.write(
        "sharp.tiff", described_tiff(encoded(".tiff", picture(restoration.sharp).astype(np.float32)), SHARP_WORDS)
    )
    folder.write("sharp_std.tiff", described_tiff(float_tiff(restoration.sharp_std), STD_WORDS))
    folder.write("sharp.png", encoded(".png", levels(picture(restoration.sharp), 0, 1)))
    folder.write("w.npy", npy(restoration.w * restoration.unit.per_pixel, np.float32))
    folder.write("w_std.npy", npy(restoration.w_std * restoration.unit.per_pixel, np.float32))
    if restoration.moved.any():
        folder.write("moved.npy", npy(restoration.moved, np.uint8))
    if restoration.occlusion.any():
        folder.write("occlusion.npy", npy(restoration.occlusion, np.uint8))
    depth = levels(restoration.w, float(restoration.w.min()), float(restoration.w.max()))
    folder.write("depth.png", encoded(".png", false_colours(depth)))
    for n, kernel in enumerate(() if restoration.kernels is None else restoration.kernels, start=1):
        folder.write(f"kernel_{n}.npy", npy(kernel))
        folder.write(f"kernel_{n}.fits", kernel_fits(kernel, n, software()["version"]))
        folder.write(f"kernel_{n}.tiff", described_tiff(float_tiff(kernel), KERNEL_WORDS.format(n)))
    for n, shape in enumerate(() if restoration.shapes is None else restoration.shapes, start=1):
        folder.write(f"shape_{n}.npy", npy(shape, np.float32))
    if restoration.ground_truth is not None:
        off = picture(np.nan_to_num(restoration.ground_truth.difference))
        folder.write("difference.tiff", described_tiff(float_tiff(off), DIFFERENCE_WORDS))


def _truth_entries(truth: GroundTruth) -> dict[str, Any]:
    keys = {entry.name: entry.name for entry in fields(truth) if entry.name != "difference"}
    keys |= {"stated_error": "told", "compared": "seen"}
    before = [db if np.isfinite(db) else None for db in truth.before_db]
    entries = {key: getattr(truth, name) for name, key in keys.items()}
    return {**entries, "before_db": before, "matrix": truth.matrix.tolist()}


def _distance_entries(distances: Distances) -> dict[str, Any]:
    known = distances.determined > 0
    return {
        "least": float(np.nanmin(distances.metres)) if known else None,
        "greatest": float(np.nanmax(distances.metres)) if known else None,
        "median_std": float(np.nanmedian(distances.std)) if known else None,
        "median_common_std": float(np.nanmedian(distances.common)) if known else None,
        "unit": "m",
        "told": distances.determined,
        "side": distances.side,
    }


def write_refusal(folder: ResultFolder, outcome: Outcome[Restoration], head: RecordHead) -> str:
    """Publish the record of a refusal, which has no other files; returns its text."""
    return write_record(
        folder, {"schema": RESTORATION, **head.told(), **verdict_entry(outcome), "software": software()}
    )


def write_plane(folder: ResultFolder, result: PlaneResult, frames: Sequence[RawFrame], head: RecordHead) -> str:
    """The result of a guided restoration: the files of `write_restoration`, or the record of its refusal."""
    from station.calibration.restoration.inputs import imu_table, poses_table

    restoration: Restoration | None = result.found
    outcome = result.outcome(restoration)
    if restoration is None:
        return write_refusal(folder, outcome, head)
    facts = facts_as(RestorationFacts, head.parameters)
    blurred, _ = split_ground_truth(frames, facts)
    for n, frame in enumerate(blurred, start=1):
        if frame.imu is not None:
            folder.write(f"imu_{n}.csv", imu_table(frame.imu))
        poses, exposure_s = rig_poses(frame), frame.exposure.exposure_s
        if frame.shaker_path is not None and poses is not None and exposure_s is not None:
            folder.write(f"poses_{n}.csv", poses_table(poses, exposure_s))
    timeless = replace(restoration, history=tuple(replace(r, seconds=0.0) for r in restoration.history))
    outcome = replace(outcome, value=timeless)  # makes the files reproducible
    photographs = [stacked(planes_of(frame, facts)) for frame in blurred]
    return write_outcome(folder, Restored(outcome, {}), head, photographs)
