"""Photographs through a measured field, corrected: reading, checking that they belong together, and the files."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from procedures.correction.checks import check_exposure
from procedures.correction.estimate import Correction, CorrectionParameters, correct
from procedures.correction.light import evened
from procedures.field.field_file import read_camera, read_colours, read_field, read_lights
from procedures.numbers import CYCLES, FIELD_ERROR, MTF50_AFTER, MTF50_BEFORE, NOISE_GAIN
from procedures.outcome import Outcome, Refused, with_doubt
from procedures.raw import Exposure, RawFrame, read_frame, read_photograph
from procedures.reading.sensor_dump import DumpLayout
from station.calibration.camera_notes import CameraNotes, read_notes
from station.calibration.picture_files import BLACK, WHITE, write_linear_dng, write_tiff
from station.results.record_head import verdict_entry

TIFF, DNG, MAPS = "corrected.tiff", "corrected.dng", "gain.csv"
DESCRIPTION = "linear light, 0 black, 65535 white, camera colours not balanced; corrected through its lens's PSF field"


@dataclass(frozen=True, eq=False)
class Corrected:
    """A photograph, further ones of the same scene, what was found, and what the first one's camera noted."""

    frame: RawFrame
    outcome: Outcome[Correction]
    notes: CameraNotes
    undone: tuple[str, ...]
    """Planes whose lateral colour was undone."""
    evened: tuple[str, ...] = ()
    """Planes whose vignetting was."""
    others: tuple[RawFrame, ...] = ()


def correct_photographs(
    photos: Sequence[Path],
    field: Path,
    parameters: CorrectionParameters,
    layout: DumpLayout | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
    *,
    insisted: bool = False,
) -> Corrected:
    """Read all, refuse what does not belong together, and correct.

    Parameters
    ----------
    photos
        The first gives the picture its frame; the others are registered to it.
    insisted : bool
        The field is taken whatever camera it is of, and the result doubted.

    Raises
    ------
    BadInput, Refused
        If one cannot be read, or the field is of another camera, lens, aperture or focus.
    """
    data = read_photograph(photos[0])
    frame = read_frame(photos[0], layout=layout, data=data)
    others = tuple(read_frame(photo, layout=layout) for photo in photos[1:])
    fields, camera = read_field(field), read_camera(field)
    unknown = ["--insist was given"] if insisted else _unknown([frame, *others], camera)
    shifts = {name: colour.shift_at for name, colour in read_colours(field).items() if name in frame.planes}
    known = read_lights(field)
    lights = {name: known[name].at for name in frame.planes if name in known}
    outcome = correct(frame, fields, shifts, parameters, progress, others)
    if lights and outcome.value is not None:
        outcome = replace(outcome, value=evened(outcome.value, outcome.value.mosaic.planes, lights))
    notes = read_notes(data, frame.exposure)
    return Corrected(frame, _doubted(outcome, unknown), notes, tuple(shifts), tuple(lights), others)


def _unknown(frames: Sequence[RawFrame], camera: Exposure | None) -> list[str]:
    """What cannot be told of whether the photographs are of the field's camera and setting.

    Raises
    ------
    Refused
        If one is not, by its name where there are several.
    """
    found: list[str] = []
    for frame in frames:
        try:
            found += check_exposure(frame.exposure, camera)
        except Refused as refusal:
            name = f"{frame.path.name}: " if len(frames) > 1 else ""
            raise Refused(f"{name}{refusal.reason}", refusal.remedy) from None
    return list(dict.fromkeys(found))


def _doubted(outcome: Outcome[Correction], unknown: list[str]) -> Outcome[Correction]:
    """The same, doubtful where it is not known whether field and photograph belong together."""
    if not unknown or outcome.value is None:
        return outcome
    reason = f"it is not known whether the field is of this lens and setting: {', '.join(unknown)}"
    remedy = "compare them yourself, or measure the field from files that hold the camera's notes"
    return with_doubt(outcome, reason, remedy)


def correction_files(value: Correction, notes: CameraNotes) -> dict[str, bytes | Callable[[Path], None]]:
    """The picture in both forms, written strip by strip, and the maps."""
    return {
        TIFF: lambda path: write_tiff(path, value.picture, notes, DESCRIPTION),
        DNG: lambda path: write_linear_dng(path, value.picture, notes),
        MAPS: _maps(value),
    }


def correction_numbers(value: Correction) -> dict[str, float]:
    """What limits can be set for: medians over the frame."""
    predicted = value.prediction
    return {
        MTF50_BEFORE: value.scale * float(np.median(predicted.before)),
        MTF50_AFTER: value.scale * float(np.median(predicted.after)),
        NOISE_GAIN: float(np.median(predicted.noise_gain)),
        FIELD_ERROR: value.field_error.rms,
    }


def correction_entries(found: Corrected) -> dict[str, Any]:
    """What `result.json` says of a correction beside its head and its numbers."""
    value = found.outcome.value
    if value is None:
        return verdict_entry(found.outcome)
    predicted = value.prediction
    return {
        **verdict_entry(found.outcome),
        "encodings": {
            TIFF: {"encoding": "linear", "black": 0, "white": 65535},
            DNG: {"encoding": "linear", "black": BLACK, "white": WHITE},
        },
        "noise": {name: asdict(one) for name, one in value.noise.items()},
        "prior": {"tau": value.tau, "mean_difference": value.difference},
        "tile_px": value.side,
        **_photographs(found, value),
        "clipped": value.clipped,
        "lateral_colour_undone": list(found.undone),
        "vignetting_undone": list(found.evened),
        "predicted": {
            MTF50_BEFORE: _number(value.scale * predicted.before, CYCLES),
            MTF50_AFTER: _number(value.scale * predicted.after, CYCLES),
            NOISE_GAIN: _number(predicted.noise_gain, "1"),
            FIELD_ERROR: {"rms": value.field_error.rms, "unit": "1", "of_noise": _rms(value.field_error.noise)},
        },
    }


def _photographs(found: Corrected, value: Correction) -> dict[str, Any]:
    """How fine the picture is and how the further photographs lie; nothing of a single one on its own grid."""
    if not value.places and value.scale == 1:
        return {}
    return {
        "scale": value.scale,
        "detail_told": value.told,
        "further_photographs": [
            {
                "path": str(frame.path),
                "moved_px": place.moved_px(value.sensor_shape).tolist(),
                "light": place.light,
                "left_over": place.left_over,
                "set_aside": place.reason,
            }
            for frame, place in zip(found.others, value.places, strict=True)
        ],
    }


def _rms(squares: Any) -> float:
    return float(np.sqrt(np.mean(squares)))


def _number(values: Any, unit: str) -> dict[str, Any]:
    return {
        "median": float(np.median(values)), "least": float(values.min()), "greatest": float(values.max()), "unit": unit
    }  # fmt: skip


def _maps(value: Correction) -> bytes:
    """Predicted MTF50 and noise over the frame, a place per row."""
    text, told = io.StringIO(newline=""), value.prediction
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["x_px", "y_px", "mtf50_before_cycles_px", "mtf50_after_cycles_px", NOISE_GAIN])
    for i, j in np.ndindex(told.before.shape):
        place = told.x[j] / value.scale, told.y[i] / value.scale
        row = (*place, value.scale * told.before[i, j], value.scale * told.after[i, j], told.noise_gain[i, j])
        table.writerow([f"{number:.6g}" for number in row])
    return text.getvalue().encode()
