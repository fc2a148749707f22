"""The sensor's tilt from photographs of a focus bracket to its record: measured, judged, written."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from procedures.field.measuring import MeasuredFrames
from procedures.outcome import BadParameter, Outcome, Refused, Verdict
from procedures.psf_field import Node
from procedures.reading.exposure import read_exposure
from procedures.reading.guard import open_file
from procedures.tilt.estimate import Tilt, TiltParameters, chart_slope, estimate_tilt
from procedures.tilt.positions import behind_lens_um
from station.common.versions import software
from station.results.exports import csv_bytes, numbers_table
from station.results.record_head import InputFile, RecordHead, verdict_entry
from station.results.result_files import ResultFolder, write_record

SCHEMA = "station/tilt/1"
PAGE = "report.html"


def measure_tilt(
    measured: MeasuredFrames, plane: str, positions: Mapping[str, float], parameters: TiltParameters
) -> Outcome[Tilt]:
    """The tilt from the nodes of all photographs whose position is known; refused where none gave any.

    Parameters
    ----------
    positions : mapping of photograph's name to position in mm
    """
    bracket: dict[float, list[Node]] = {}
    for node in measured.nodes.get(plane, ()):
        if node.source in positions:
            bracket.setdefault(positions[node.source], []).append(node)
    if not bracket:
        why = measured.misses[0] if measured.misses else None
        reason = "none of the photographs whose position is told gives a PSF" + (f"; {why.reason}" if why else "")
        return Outcome(None, Verdict.REFUSED, reason, why.remedy if why else "add names and positions to the table")
    of = measured.planes[plane]
    rows, columns = of.samples.shape
    try:
        return estimate_tilt(bracket, (int(rows), int(columns)), of.pitch, parameters)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)


def noted_optics(first: Path, pitch_um: float | None, focal_length_mm: float | None) -> tuple[float, float | None]:
    """Pixel pitch and focal length, as typed or as a photograph tells. Raises BadParameter where no pitch is told."""
    with open_file(first) as file:
        noted = read_exposure(file)
    pitch = pitch_um or noted.pixel_pitch_um
    if pitch is None:
        raise BadParameter("the pixel pitch is not known: the photographs do not tell it", "give --pixel-pitch-um")
    return pitch, focal_length_mm or noted.focal_length_mm


def check_known(parameters: TiltParameters, positions: Mapping[str, float]) -> None:
    """Raises BadParameter where something that the estimate of this bracket rests on is not known."""
    chart_slope(list(positions.values()), parameters)
    nominal = () if parameters.nominal_mm is None else (parameters.nominal_mm,)
    for position in (*positions.values(), *nominal):
        behind_lens_um(position, parameters.positions, parameters.focal_length_mm)


def write_tilt_result(
    folder: ResultFolder,
    measured: MeasuredFrames,
    plane: str,
    outcome: Outcome[Tilt],
    *,
    parameters: Mapping[str, Any],
    start: float,
    page: str | None = None,
) -> str:
    """Write the places' table, the numbers and the record; returns the record's text."""
    files = tuple(InputFile(str(path), sha256) for path, sha256 in measured.frames)
    return write_tilt_record(folder, RecordHead("tilt", files, dict(parameters)), plane, outcome, page, start)


def write_tilt_record(
    folder: ResultFolder,
    head: RecordHead,
    plane: str,
    outcome: Outcome[Tilt],
    page: str | None = None,
    start: float | None = None,
) -> str:
    """The same; `start` tells when it began where that is to be told."""
    entry = verdict_entry(outcome)
    if (found := outcome.value) is not None:
        folder.write("tilt.csv", csv_bytes(_places(found)))
        folder.write("numbers.csv", numbers_table((plane, name, one) for name, one in found.numbers().items()))
        entry |= {**{name: asdict(one) for name, one in found.numbers().items()}, **_told(found)}
    if page is not None:
        folder.write(PAGE, page.encode())
    if start is not None:
        head = replace(head, duration_s=round(time.perf_counter() - start, 3))
    return write_record(folder, {"schema": SCHEMA, **head.told(), "planes": {plane: entry}, "software": software()})


def _told(found: Tilt) -> dict[str, Any]:
    sensor, turns = found.sensor, found.turns
    return {
        "helps": turns.helps,
        "screws": [
            {"angle_deg": float(angle), "move": asdict(move), "turn": asdict(turn)}
            for angle, move, turn in zip(found.screws.angles_deg, turns.moves, turns.turns, strict=True)
        ],
        "plane": {
            "offset_um": float(sensor.plane[0]), "slopes_um_per_mm": sensor.plane[1:].tolist(),
            "covariance": sensor.covariance.tolist(),
        },
        "diagnostics": {"misfit": sensor.misfit, "chance": sensor.chance},
    }  # fmt: skip


def _places(found: Tilt) -> list[list[str]]:
    sensor = found.sensor
    rows = np.column_stack([sensor.places_mm, sensor.heights_um, sensor.residuals_um, found.astigmatism])
    head = ["x [mm]", "y [mm]", "height [um]", "residual [um]", "astigmatism [um]"]
    return [head, *([f"{value:.6g}" for value in row] for row in rows)]
