"""Correction of photographs by a measured field: input, checks that they match, and files."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from procedures.correction.checks import check_exposure
from procedures.correction.estimate import Correction, CorrectionParameters, correct
from procedures.correction.light import evened
from procedures.field.field_file import read_camera, read_colours, read_field, read_lights
from procedures.numbers import CURVE_ERROR, CYCLES, FIELD_ERROR, MTF50_AFTER, MTF50_BEFORE, NOISE_GAIN
from procedures.outcome import Outcome, Refused, mark_doubtful
from procedures.pattern_psf.estimate import PUPIL_SPREAD
from procedures.pattern_psf.focus.aperture import CONTRADICTION_SIGMAS, mean_f_number
from procedures.psf_field import PsfField
from procedures.quality import OPERATOR, WAVELENGTHS_NM, Diffraction
from procedures.raw import Exposure, RawFrame
from procedures.reading.development import OF_PROFILE, linear_profile
from procedures.reading.tiff_tags import ICC_PROFILE
from station.calibration.camera_metadata import CameraMetadata, metadata_of
from station.calibration.picture_files import BLACK, WHITE, write_linear_dng, write_tiff
from station.calibration.restoration.developed import picture_file, unknown_of, wrong_curve
from station.results.exports import csv_columns
from station.results.record_head import verdict_entry

TIFF, DNG, MAPS = "corrected.tiff", "corrected.dng", "gain.csv"
DESCRIPTION = "linear light, 0 black, 65535 white, {}; corrected through its lens's PSF field"


@dataclass(frozen=True, eq=False)
class Corrected:
    """A photograph and further ones of the same scene, with the correction and the metadata of the first. `undone` and
    `evened` are the planes corrected for lateral colour and for vignetting."""

    frame: RawFrame
    outcome: Outcome[Correction]
    metadata: CameraMetadata
    undone: tuple[str, ...]
    evened: tuple[str, ...] = ()
    others: tuple[RawFrame, ...] = ()


def correct_photographs(
    photographs: Sequence[RawFrame],
    field: Path,
    parameters: CorrectionParameters,
    progress: Callable[[int, int], None] = lambda done, of: None,
    *,
    insisted: bool = False,
    typed: "TypedAperture | None" = None,
) -> Corrected:
    """Check that photographs match the field, and correct them.

    Raises BadInput, Refused if the field cannot be read, or is of another camera, lens, aperture or focus.

    photographs : the first defines the frame of the picture; the others are registered to it
    insisted : the field is used for any camera, and the result flagged as doubtful
    typed : the aperture of a lens that the camera does not know, which stands for its settings
    """
    frame, *others = (_with_green(photograph) for photograph in photographs)
    fields, camera = read_field(field), read_camera(field)
    unknown = ["--insist was given"] if insisted else _unknown([frame, *others], camera)
    if typed and not insisted and frame.exposure.f_number is None:
        unknown = unknown_with_typed(unknown, typed, fields, frame, camera)
    shifts = {name: colour.shift_at for name, colour in read_colours(field).items() if name in frame.planes}
    known = {} if frame.development else read_lights(field)
    lights = {name: known[name].at for name in frame.planes if name in known}
    outcome = correct(frame, fields, shifts, parameters, progress, others)
    if lights and outcome.value is not None:
        outcome = replace(outcome, value=evened(outcome.value, outcome.value.mosaic.planes, lights))
    if unknown and outcome.value is not None:
        reason = f"it is not known whether the field is of this lens and setting: {', '.join(unknown)}"
        remedy = "compare them yourself, or measure the field from files with the camera's metadata"
        outcome = mark_doubtful(outcome, reason, remedy)
    outcome = _judged(outcome, frame)
    return Corrected(frame, outcome, metadata_of(frame), tuple(shifts), tuple(lights), tuple(others))


@dataclass(frozen=True)
class TypedAperture:
    """Aperture of a lens without contacts as the operator states it, and the sensor's pitch if no file has it."""

    f_number: float
    pixel_pitch_um: float | None = None


def unknown_with_typed(
    unknown: list[str], typed: TypedAperture, fields: Mapping[str, PsfField], frame: RawFrame, camera: Exposure | None
) -> list[str]:
    """The unknown settings less those that a typed f-number stands for, if the field's far tail agrees with it. Raises
    Refused if the field has another aperture, by its file or by its far tail."""
    if camera is not None:
        check_exposure(replace(frame.exposure, f_number=typed.f_number), camera)
    pitch = typed.pixel_pitch_um or frame.exposure.pixel_pitch_um
    tails = [
        (node.psf, Diffraction(typed.f_number, (1 if name == "Y" else 2) * pitch, WAVELENGTHS_NM[name[0]], OPERATOR))
        for name, field in fields.items() if field.q and pitch for node in field.nodes
    ]  # fmt: skip
    if not tails:
        return [*unknown, "the far tail (--pixel-pitch-um is needed)"]
    value, uncertainty = mean_f_number(tails)
    if abs(value - typed.f_number) > CONTRADICTION_SIGMAS * np.hypot(uncertainty, PUPIL_SPREAD * typed.f_number):
        raise Refused(f"the field's far tail is that of f/{value:.1f}; f/{typed.f_number:g} was given", _CORRECT_IT)
    return [one for one in unknown if one not in SETTINGS]


SETTINGS = ("lens", "aperture", "focal length", "focus distance")
_CORRECT_IT = "correct --f-number, or measure the field at the photograph's aperture"


def _with_green(frame: RawFrame) -> RawFrame:
    """The photograph; green of a developed picture under the name of a mosaic's."""
    planes = {("G1" if name == "G" else name): plane for name, plane in frame.planes.items()}
    return replace(frame, planes={name: replace(plane, name=name) for name, plane in planes.items()})


def _judged(outcome: Outcome[Correction], frame: RawFrame) -> Outcome[Correction]:
    if frame.development is None or outcome.value is None:
        return outcome
    for caveat in (wrong_curve([frame]), _by_curve(outcome.value), unknown_of([frame.development])):
        outcome = mark_doubtful(outcome, *caveat) if caveat else outcome
    return mark_doubtful(outcome, *_DEMOSAICKED)


def _by_curve(value: Correction) -> tuple[str, str] | None:
    if (error := value.curve_error) is None:
        return None
    reason = (
        f"under other plausible tone curves the picture's light differs by {error.light:.1%} of white, and its levels "
        f"by {error.levels:.1%}"
    )
    return reason, "give the RAW file, or a file without loss with its ICC profile or --encoding"


_DEMOSAICKED = (
    "a developed picture is corrected as if its pixels were the sensor's: demosaicking and lens corrections remain",
    "give the RAW file",
)


def _unknown(frames: Sequence[RawFrame], camera: Exposure | None) -> list[str]:
    """Settings for which it is not known whether they agree with those of the field. Raises Refused if one differs;
    names the photograph where there are several."""
    unknown: list[str] = []
    for frame in frames:
        try:
            unknown += check_exposure(frame.exposure, camera)
        except Refused as refusal:
            name = f"{frame.path.name}: " if len(frames) > 1 else ""
            raise Refused(f"{name}{refusal.reason}", refusal.remedy) from None
    return list(dict.fromkeys(unknown))


def correction_files(corrected: Corrected) -> dict[str, bytes | Callable[[Path], None]]:
    """The picture, written strip by strip, and the maps; as TIFF and DNG, or in a developed photograph's format."""
    value, metadata, development = corrected.outcome.value, corrected.metadata, corrected.frame.development
    if value is None:
        return {}
    words = DESCRIPTION.format("the file's own colours" if development else "camera colours not balanced")
    if development and development.curve.name == OF_PROFILE:
        profile = linear_profile(development.icc)
        metadata = replace(metadata, picture={**metadata.picture, ICC_PROFILE: (7, len(profile), profile)})
    pictures = picture_file(corrected.frame, value.picture, words="corrected picture")
    predicted = value.prediction
    y, x = np.meshgrid(predicted.y, predicted.x, indexing="ij")
    columns = {
        "x_px": x / value.scale, "y_px": y / value.scale, "mtf50_before_cycles_px": value.scale * predicted.before,
        "mtf50_after_cycles_px": value.scale * predicted.after, NOISE_GAIN: predicted.noise_gain,
    }  # fmt: skip
    return {
        TIFF: lambda path: write_tiff(path, value.picture, metadata, words),
        **(pictures or {DNG: lambda path: write_linear_dng(path, value.picture, metadata)}),
        MAPS: csv_columns({name: column.ravel() for name, column in columns.items()}, 6),
    }


def correction_numbers(value: Correction) -> dict[str, float]:
    """The numbers with limits: medians over the frame."""
    predicted = value.prediction
    return {
        MTF50_BEFORE: value.scale * float(np.median(predicted.before)),
        MTF50_AFTER: value.scale * float(np.median(predicted.after)),
        NOISE_GAIN: float(np.median(predicted.noise_gain)),
        FIELD_ERROR: value.field_error.rms,
        **({CURVE_ERROR: value.curve_error.light} if value.curve_error else {}),
    }


def correction_entries(corrected: Corrected) -> dict[str, Any]:
    """Entries of `result.json` in addition to head and numbers."""
    value = corrected.outcome.value
    if value is None:
        return verdict_entry(corrected.outcome)
    development, curve = corrected.frame.development, value.curve_error
    predicted, noise = value.prediction, float(np.sqrt(np.mean(value.field_error.noise)))
    return {
        **verdict_entry(corrected.outcome),
        "encodings": {
            TIFF: {"encoding": "linear", "black": 0, "white": 65535},
            **({} if development else {DNG: {"encoding": "linear", "black": BLACK, "white": WHITE}}),
        },
        **({"encoding": development.curve.name} if development else {}),
        "noise": {name: asdict(one) for name, one in value.noise.items()},
        "prior": {"tau": value.tau, "mean_difference": value.difference},
        "tile_px": value.side,
        **_photographs(corrected, value),
        "clipped": value.clipped,
        "lateral_colour_undone": list(corrected.undone),
        "vignetting_undone": list(corrected.evened),
        "predicted": {
            MTF50_BEFORE: _number(value.scale * predicted.before, CYCLES),
            MTF50_AFTER: _number(value.scale * predicted.after, CYCLES),
            NOISE_GAIN: _number(predicted.noise_gain, "1"),
            FIELD_ERROR: {"rms": value.field_error.rms, "unit": "1", "of_noise": noise},
            **({CURVE_ERROR: {"rms": curve.light, "unit": "1", "of_levels": curve.levels}} if curve else {}),
        },
    }


def _photographs(corrected: Corrected, value: Correction) -> dict[str, Any]:
    """Scale of the picture and registration of further photographs; empty for a single one on its own grid."""
    if not value.places and value.scale == 1:
        return {}
    return {
        "scale": value.scale,
        "detail_resolved": value.resolved,
        "further_photographs": [
            {
                "path": str(frame.path),
                "moved_px": place.moved_px(value.sensor_shape).tolist(),
                "light": place.light,
                "residual": place.residual,
                "set_aside": place.reason,
            }
            for frame, place in zip(corrected.others, value.places, strict=True)
        ],
    }


def _number(values: Any, unit: str) -> dict[str, Any]:
    return {
        "median": float(np.median(values)), "least": float(values.min()), "greatest": float(values.max()), "unit": unit
    }  # fmt: skip
