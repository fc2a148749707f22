"""The sensor's tilt from a focus bracket: estimate and measurement."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from procedures.field.measuring import MeasuredFrames
from procedures.outcome import BadParameter, Miss, Outcome, Verdict
from procedures.psf_field import Node
from procedures.reading.exposure import read_exposure
from procedures.reading.guard import open_file
from procedures.tilt.estimate import Tilt, TiltParameters, chart_slope, estimate_tilt, shim_words
from procedures.tilt.plane import SURE, behind_lens_um
from station.results.exports import csv_columns
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead

SCHEMA = "station/tilt/1"


def measure_tilt(
    measured: MeasuredFrames, plane: str, positions: Mapping[str, float], parameters: TiltParameters
) -> Outcome[Tilt]:
    """The tilt from nodes of photographs at known positions in mm by name; refused where there are none."""
    bracket: dict[float, list[Node]] = {}
    for node in measured.nodes.get(plane, ()):
        if node.source in positions:
            bracket.setdefault(positions[node.source], []).append(node)
    if not bracket:
        miss = measured.misses[0] if measured.misses else None
        reason = "no photograph with a known position gives a PSF" + (f"; {miss.reason}" if miss else "")
        return Outcome(None, Verdict.REFUSED, reason, miss.remedy if miss else "add names and positions to the table")
    rows, columns = measured.planes[plane].samples.shape
    return estimate_tilt(bracket, (int(rows), int(columns)), measured.planes[plane].pitch, parameters)


def known_optics(first: Path, pitch_um: float | None, focal_length_mm: float | None) -> tuple[float, float | None]:
    """Pixel pitch and focal length, as given or from a photograph. Raises BadParameter without a pitch."""
    with open_file(first) as file:
        exposure = read_exposure(file)
    pitch = pitch_um or exposure.pixel_pitch_um
    if pitch is None:
        raise BadParameter("the pixel pitch is required; the photographs do not contain it", "give --pixel-pitch-um")
    return pitch, focal_length_mm or exposure.focal_length_mm


def check_known(parameters: TiltParameters, positions: Mapping[str, float]) -> None:
    """Raises BadParameter where an input of the estimate is missing."""
    chart_slope(list(positions.values()), parameters)
    nominal = () if parameters.nominal_mm is None else (parameters.nominal_mm,)
    for position in (*positions.values(), *nominal):
        behind_lens_um(position, parameters.positions, parameters.focal_length_mm)


def tilt_measurement(
    head: RecordHead, plane: str, outcome: Outcome[Tilt], missed: Sequence[Miss] | None = None
) -> Measurement:
    """The numbers, the screws and the table of the nodes."""
    tilt, lost = outcome.value, tuple(missed) if missed else None
    if tilt is None:
        return Measurement(SCHEMA, head, (PlaneResult.of_outcome(plane, outcome, pitch=0),), missed=lost)
    result = PlaneResult.of_outcome(
        plane, outcome, numbers=tilt.numbers(), estimate=tilt, pitch=0, details=_details(tilt)
    )
    return Measurement(SCHEMA, head, (result,), files={"tilt.csv": _table(tilt)}, missed=lost)


def screw_lines(tilt: Tilt) -> list[str]:
    """Move and turn of each screw, the shim, and whether a correction is worthwhile."""
    lines = []
    for number, (angle, move, turn) in enumerate(
        zip(tilt.screws.angles_deg, tilt.turns.moves, tilt.turns.turns, strict=True), 1
    ):
        way = "away from" if move.value > 0 else "towards"
        lines.append(
            f"screw {number} at {angle:.0f} degrees: {abs(move.value):.1f} ± {move.uncertainty:.1f} um {way} the lens, "
            f"{abs(turn.value):.3f} turn ({abs(turn.value) * 360:.0f} degrees)"
        )
    helps = tilt.turns.helps
    advice = "turn, and measure again" if helps >= SURE else "leave it: that is within the uncertainty"
    shim = [words] if (words := shim_words(tilt)) else []
    return [*lines, *shim, f"these turns help with a probability of {helps:.2f}: {advice}"]


def _details(tilt: Tilt) -> dict[str, Any]:
    sensor, turns = tilt.sensor, tilt.turns
    return {
        "helps": turns.helps,
        "screws": [
            {"angle_deg": float(angle), "move": asdict(move), "turn": asdict(turn)}
            for angle, move, turn in zip(tilt.screws.angles_deg, turns.moves, turns.turns, strict=True)
        ],
        "plane": {
            "offset_um": float(sensor.plane[0]), "slopes_um_per_mm": sensor.plane[1:].tolist(),
            "covariance": sensor.covariance.tolist(),
        },
        "diagnostics": {"misfit": sensor.misfit, "chance": sensor.chance},
    }  # fmt: skip


def _table(tilt: Tilt) -> bytes:
    sensor = tilt.sensor
    x, y = sensor.places_mm.T
    columns = {"x [mm]": x, "y [mm]": y, "height [um]": sensor.heights_um, "residual [um]": sensor.residuals_um}
    return csv_columns({**columns, "astigmatism [um]": tilt.astigmatism}, 6)
