"""Files of a restoration: picture, depth, their pictures for people, and the record."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.outcome import Outcome
from procedures.raw import RawFrame
from procedures.restoration.joint.estimate import Restoration
from procedures.restoration.photograph_blur import shown
from station.drawing.depth_pictures import coloured, encoded, levels, picture
from station.results.restored import RESTORATION
from station.results.result_files import RECORD, ResultFolder, plain, software, write_record

Array = npt.NDArray[np.floating[Any]]


def write_restoration(
    folder: ResultFolder, outcome: Outcome[Restoration], about: Mapping[str, Any], page: bytes
) -> str:
    """Stage and publish every file; returns the record's text.

    about : procedure, input, parameters, duration_s; page : the report
    """
    found = outcome.value
    if found is None:
        raise ValueError("a restoration without a value has no files")
    folder.write("sharp.tiff", encoded(".tiff", picture(found.sharp).astype(np.float32)))
    folder.write("sharp.png", encoded(".png", levels(picture(found.sharp), 0, 1)))
    unit = found.unit
    folder.write("w.npy", _npy(found.w * unit.per_pixel))
    folder.write("w_std.npy", _npy(found.w_std * unit.per_pixel))
    folder.write("depth.png", encoded(".png", coloured(found.w)))
    folder.write("report.html", page)
    record = {
        "schema": RESTORATION,
        **about,
        "verdict": str(outcome.verdict),
        "reason": outcome.reason,
        "remedy": outcome.remedy,
        "w": {
            "least": float(found.w.min()) * unit.per_pixel,
            "greatest": float(found.w.max()) * unit.per_pixel,
            "unit": unit.name,
            "per_pixel": unit.per_pixel,
        },
        "shift": {"x_y": found.shifts.tolist(), "unit": "pixel"},
        "light": found.light.tolist(),
        "diagnostics": asdict(found.diagnostics),
        "iterations": [
            {"n": r.n, "what": r.what, "cost": r.cost, "residual": r.residual, "change": r.change, "seconds": r.seconds}
            for r in found.history
        ],
        "software": software(),
    }
    text = json.dumps(plain(record), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    folder.write(RECORD, text.encode())
    folder.publish()
    return text


def write_refusal(folder: ResultFolder, outcome: Outcome[Restoration], about: Mapping[str, Any]) -> str:
    """Publish the record of a refusal, which has no other files; returns its text."""
    told = {"verdict": str(outcome.verdict), "reason": outcome.reason, "remedy": outcome.remedy}
    return write_record(folder, {"schema": RESTORATION, **about, **told, "software": software()})


def write_result(
    folder: ResultFolder, outcomes: Mapping[str, Outcome[Any]], frames: Sequence[RawFrame], about: Mapping[str, Any]
) -> str:
    """The result of a guided restoration: the files of `write_restoration`, or the record of its refusal."""
    from station.calibration.restoration_inputs import imu_table
    from station.reports.restoration_page import restoration_page  # here: it draws, which is slow to load

    (outcome,) = outcomes.values()
    if outcome.value is None:
        return write_refusal(folder, outcome, about)
    for n, frame in enumerate((frames[0], frames[len(frames) - 1]), start=1):
        if frame.felt is not None:
            folder.write(f"imu_{n}.csv", imu_table(frame.felt))
    timeless = replace(outcome.value, history=tuple(replace(r, seconds=0.0) for r in outcome.value.history))
    outcome = replace(outcome, value=timeless)  # the files are the same whenever they are computed
    photographs = [shown(frame).samples.astype(np.float64)[None] for frame in (frames[0], frames[len(frames) - 1])]
    return write_restoration(folder, outcome, about, restoration_page(outcome, photographs, about))


def _npy(array: Array) -> bytes:
    data = io.BytesIO()
    np.save(data, np.asarray(array, dtype=np.float32), allow_pickle=False)
    return data.getvalue()
