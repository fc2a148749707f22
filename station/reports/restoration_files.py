"""Measurement of a restoration: picture, depth, previews, and entries of the record."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numbers import PICTURE_STD, W_GREATEST, W_LEAST, W_MEDIAN
from procedures.outcome import Outcome, Quantity
from procedures.restoration.joint.result import Restoration
from procedures.restoration.metres import Distances
from station.common.versions import software
from station.drawing.pictures import described_tiff, encoded, false_colours, float_tiff, levels, picture
from station.results.explanation import BRIGHTER, BUDGETS
from station.results.exports import kernel_fits
from station.results.measurement import RESTORATION, Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, verdict_entry
from station.results.result_files import npy

SHARP_WORDS = "restored picture, linear, 1 = white, first row uppermost; calibration-station"
STD_WORDS = "standard deviation of the restored picture, 1 = white, first row uppermost; calibration-station"
KERNEL_WORDS = "kernel of photograph {}, one sample a pixel, sum 1, first row uppermost; calibration-station"
DIFFERENCE_WORDS = "restored picture less the ground truth, 1 = white, 0 where not compared; calibration-station"
Array = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Restored:
    """A restoration with its photographs (C, H, W) each, and depth in metres, if requested."""

    outcome: Outcome[Restoration]
    photographs: Sequence[Array]
    distances: Distances | None = None


def restoration_measurement(name: str, result: Restored, head: RecordHead) -> Measurement:
    """The measurement of the planes together, called `name`; a refusal has no files."""
    outcome, restoration = result.outcome, result.outcome.value
    if restoration is None:
        return Measurement(
            RESTORATION, head, (restored_plane(name, outcome),), entries=verdict_entry(outcome), results_key="result"
        )
    plane = restored_plane(name, outcome)
    entries = {**verdict_entry(outcome), **_entries(restoration, result.distances)}
    return Measurement(
        RESTORATION, head, (plane,), entries=entries, files=_files(restoration, result.distances),
        results_key="result", result=result,
    )  # fmt: skip


def restored_plane(name: str, outcome: Outcome[Restoration]) -> PlaneResult:
    """Verdict, depth and diagnostics of a restoration; verdict alone of a refusal."""
    restoration = outcome.value
    if restoration is None:
        return PlaneResult.of_outcome(name, outcome, pitch=0)
    per, unit = restoration.unit.per_pixel, restoration.unit.name
    spread = float(np.median(restoration.w_std)) * per
    method = "median over the map; uncertainty: the median of each place's least"
    numbers = {W_MEDIAN: Quantity(float(np.median(restoration.w)) * per, unit, spread, method, restoration.w.size)}
    values = {W_LEAST: float(restoration.w.min()) * per, W_GREATEST: float(restoration.w.max()) * per,
              **asdict(restoration.diagnostics)}  # fmt: skip
    details = {BUDGETS: {PICTURE_STD: dict(restoration.budget)}, BRIGHTER: restoration.brighter}
    return PlaneResult.of_outcome(
        name, outcome, numbers=numbers, values=values, pitch=0, estimate=restoration, details=details
    )


def _entries(restoration: Restoration, distances: Distances | None) -> dict[str, Any]:
    unit = restoration.unit
    entries: dict[str, Any] = {
        "w": {
            "least": float(restoration.w.min()) * unit.per_pixel,
            "greatest": float(restoration.w.max()) * unit.per_pixel,
            "unit": unit.name,
            "per_pixel": unit.per_pixel,
        }
    }
    if restoration.kernels is not None:
        entries["kernels"] = {"count": len(restoration.kernels), "samples_per_pixel": 1}
    if restoration.shapes is not None:
        entries["shapes"] = {"count": len(restoration.shapes)}
    if distances is not None:
        known = distances.determined > 0
        entries["distance"] = {
            "least": float(np.nanmin(distances.metres)) if known else None,
            "greatest": float(np.nanmax(distances.metres)) if known else None,
            "median_std": float(np.nanmedian(distances.std)) if known else None,
            "median_common_std": float(np.nanmedian(distances.common)) if known else None,
            "unit": "m",
            "determined": distances.determined,
            "side": distances.side,
        }
    if (truth := restoration.ground_truth) is not None:
        names = [entry.name for entry in fields(truth) if entry.name != "difference"]
        entries["ground_truth"] = {
            **{name: getattr(truth, name) for name in names},
            "before_db": [db if np.isfinite(db) else None for db in truth.before_db],
            "matrix": truth.matrix.tolist(),
        }
    return entries | {
        "shift": {"x_y": restoration.shifts.tolist(), "unit": "pixel"},
        "turn": {"value": np.rad2deg(restoration.turns).tolist(), "unit": "degree"},
        "zoom": restoration.zooms.tolist(),
        "light": restoration.light.tolist(),
        "diagnostics": asdict(restoration.diagnostics),
        "iterations": [
            {name: getattr(one, name) for name in ("n", "what", "cost", "residual", "change", "seconds")}
            for one in restoration.history
        ],
    }


def _files(restoration: Restoration, distances: Distances | None) -> dict[str, Callable[[Path], None]]:
    sharp, per = picture(restoration.sharp), restoration.unit.per_pixel
    depth = levels(restoration.w, float(restoration.w.min()), float(restoration.w.max()))
    files = {
        "sharp.tiff": _file(lambda: described_tiff(encoded(".tiff", sharp.astype(np.float32)), SHARP_WORDS)),
        "sharp_std.tiff": _tiff(restoration.sharp_std, STD_WORDS),
        "sharp.png": _file(lambda: encoded(".png", levels(sharp, 0, 1))),
        "w.npy": _array(restoration.w * per),
        "w_std.npy": _array(restoration.w_std * per),
        "depth.png": _file(lambda: encoded(".png", false_colours(depth))),
    }
    files |= {
        f"{name}.npy": _array(mask, np.uint8)
        for name in ("moved", "occlusion")
        if (mask := getattr(restoration, name)).any()
    }
    for n, kernel in enumerate(() if restoration.kernels is None else restoration.kernels, start=1):
        files[f"kernel_{n}.npy"] = _array(kernel, np.float64)
        files[f"kernel_{n}.fits"] = _file(partial(kernel_fits, kernel, n, software()["version"]))
        files[f"kernel_{n}.tiff"] = _tiff(kernel, KERNEL_WORDS.format(n))
    for n, shape in enumerate(() if restoration.shapes is None else restoration.shapes, start=1):
        files[f"shape_{n}.npy"] = _array(shape)
    if distances is not None:
        files |= {"distance.npy": _array(distances.metres), "distance_std.npy": _array(distances.std)}
    if restoration.ground_truth is not None:
        files["difference.tiff"] = _tiff(picture(np.nan_to_num(restoration.ground_truth.difference)), DIFFERENCE_WORDS)
    return files


def _file(make: Callable[[], bytes]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_bytes(make())

    return write


def _array(array: Array, dtype: npt.DTypeLike = np.float32) -> Callable[[Path], None]:
    return _file(lambda: npy(array, dtype))


def _tiff(array: Array, words: str) -> Callable[[Path], None]:
    return _file(lambda: described_tiff(float_tiff(array), words))
