"""Exposure data of a photograph from LibRaw and EXIF, with the source of every field."""

import logging
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any, BinaryIO, cast

from procedures.outcome import BadParameter


@dataclass(frozen=True)
class Exposure:
    """Exposure data recorded by the camera; None where missing. `sources` names the source of each field."""

    camera: str | None = None
    lens: str | None = None
    exposure_s: float | None = None
    f_number: float | None = None
    iso: float | None = None
    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None
    subject_distance_mm: float | None = None
    captured_at: str | None = None
    sources: Mapping[str, str] | None = None


Field = float | str
Tags = Mapping[str, Any]


def read_exposure(file: BinaryIO, raw: Any = None) -> Exposure:
    """Read the exposure data of one file.

    file : a seekable binary file, read for EXIF
    raw : rawpy.RawPy, the file opened by LibRaw, whose answers have priority
    """
    tags = _exif_tags(file)
    answers: dict[str, Field] = {}
    sources: dict[str, str] = {}
    distance_m = _number(tags, "EXIF SubjectDistance", "Image SubjectDistance")
    from_exif = {
        "camera": _camera(_text(tags, "Image Make"), _text(tags, "Image Model")),
        "lens": _text(tags, "EXIF LensModel"),
        "exposure_s": _number(tags, "EXIF ExposureTime", "Image ExposureTime"),
        "f_number": _number(tags, "EXIF FNumber", "Image FNumber"),
        "iso": _number(tags, "EXIF ISOSpeedRatings", "EXIF PhotographicSensitivity", "Image ISOSpeedRatings"),
        "focal_length_mm": _number(tags, "EXIF FocalLength", "Image FocalLength"),
        "pixel_pitch_um": _pitch_um(tags),
        "subject_distance_mm": None if distance_m is None else 1000.0 * distance_m,
        "captured_at": _moment(_text(tags, "EXIF DateTimeOriginal") or _text(tags, "Image DateTime")),
    }
    for source, fields in (("LibRaw", _from_libraw(raw, tags)), ("EXIF", from_exif)):
        for name, value in fields.items():
            if value is not None and name not in answers:
                answers[name], sources[name] = value, source
    return Exposure(**answers, sources=sources)  # type: ignore[arg-type]  # the keys are the names of fields


def _exif_tags(file: BinaryIO) -> Tags:
    import exifread

    logging.getLogger("exifread").addHandler(logging.NullHandler())
    try:
        tags: Tags = exifread.process_file(cast(BinaryIO, _LimitedFile(file)), details=False)
    except Exception:  # exposure data are optional: damaged tags must not prevent reading the pixels
        return {}
    return tags


MAX_METADATA_BYTES = 1 << 26  # limit of bytes read for metadata; a camera writes some thousand
MIN_BYTES_PER_READ = 64  # bytes that each read counts at least, to limit the time


class _LimitedFile:
    """File with a limit of bytes read, since damaged tags may refer to the whole file a thousand times."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._left = file, MAX_METADATA_BYTES
        file.seek(0)
        self.seek, self.tell = file.seek, file.tell

    def read(self, n: int = -1) -> bytes:
        """Read bytes. Raises EOFError beyond the limit."""
        data = self._file.read(n if 0 <= n < self._left else self._left)
        self._left -= max(len(data), MIN_BYTES_PER_READ)
        if self._left <= 0:
            raise EOFError("the file has more metadata than any camera writes")
        return data


def _from_libraw(raw: Any, tags: Tags) -> dict[str, Field | None]:
    """LibRaw's fields. It turns an ApertureValue of 0 into f/1 and a ShutterSpeedValue of 0 into 1 s, so these are
    ignored where FNumber or ExposureTime is 0."""
    if raw is None:
        return {}
    other, lens = raw.other, raw.lens
    return {
        "lens": lens.model.strip() or None,
        "exposure_s": None if _blank(tags, "EXIF ExposureTime") else _positive(_rounded(other.shutter_speed)),
        "f_number": None if _blank(tags, "EXIF FNumber") else _positive(_rounded(other.aperture)),
        "iso": _positive(other.iso_speed),
        "focal_length_mm": _positive(_rounded(other.focal_length)),
        "captured_at": other.timestamp.isoformat(timespec="seconds") if other.timestamp.timestamp() > 0 else None,
    }


_MICROMETRES = {2: 25400.0, 3: 10000.0, 4: 1000.0, 5: 1.0}
"""Micrometres per EXIF FocalPlaneResolutionUnit: inch, centimetre, and two unofficial ones."""


def _pitch_um(tags: Tags) -> float | None:
    """Pixel pitch from EXIF FocalPlaneXResolution, in pixels per unit; the default unit is the inch."""
    resolution = _number(tags, "EXIF FocalPlaneXResolution", "Image FocalPlaneXResolution")
    unit = _number(tags, "EXIF FocalPlaneResolutionUnit", "Image FocalPlaneResolutionUnit") or 2
    if resolution is None or unit not in _MICROMETRES:
        return None
    return _MICROMETRES[int(unit)] / resolution


def _positive(value: float) -> float | None:
    return float(value) if math.isfinite(value) and value > 0 else None


def _rounded(value: float) -> float:
    """Round to seven digits, since LibRaw has single precision: 5.599999904632568."""
    return float(f"{value:.7g}")


def _blank(tags: Tags, name: str) -> bool:
    return name in tags and _number(tags, name) is None


def _number(tags: Tags, *names: str) -> float | None:
    """Value of the first tag with a positive finite number."""
    for name in names:
        with suppress(KeyError, IndexError, TypeError, ValueError, ZeroDivisionError):
            if value := _positive(float(tags[name].values[0])):
                return value
    return None


def _text(tags: Tags, name: str) -> str | None:
    text = str(tags[name]).strip("\0 ") if name in tags else ""
    return text or None


def _camera(make: str | None, model: str | None) -> str | None:
    if make and model and not model.lower().startswith(make.split()[0].lower()):
        return f"{make} {model}"
    return model or make


def _moment(text: str | None) -> str | None:
    try:
        return datetime.strptime(text or "", "%Y:%m:%d %H:%M:%S").isoformat()
    except ValueError:
        return None


TYPED = {"f_number": ("f-number", "", 0.04), "focal_length_mm": ("focal length", " mm", 0.06),
         "pixel_pitch_um": ("pixel pitch", " µm", 0.06)}  # fmt: skip
"""Name, unit and relative tolerance of typed settings: f-numbers are rounded by up to 3 % (22 for 22.6), focal lengths
and sizes of sensors are nominal."""


def disagreements(exposure: Exposure, typed: Mapping[str, float | None]) -> list[str]:
    """Sentences on typed settings that differ from recorded ones; `typed` by the names of `TYPED`."""
    by_camera = asdict(exposure)
    return [
        f"the {words} was given as {value:g}{unit}, but the camera recorded {recorded:g}{unit}"
        for name, (words, unit, tolerance) in TYPED.items()
        if (value := typed.get(name)) and (recorded := by_camera[name]) and abs(value / recorded - 1) > tolerance
    ]


def check_typed(exposure: Exposure, typed: Mapping[str, float | None], name: str, insist: str) -> None:
    """Reject settings that contradict the photograph.

    Raises BadParameter if a setting differs from the recorded one.

    name : name of the photograph
    insist : str, instruction to keep the typed value
    """
    fields = disagreements(exposure, typed)
    if fields:
        raise BadParameter(f"{name}: {'; '.join(fields)}", f"omit or correct it; to keep it, {insist}")
