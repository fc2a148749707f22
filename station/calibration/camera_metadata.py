"""Metadata of a photograph, copied into files that derive from it.

Entries of the first image directory and of EXIF are copied in either byte order; for files other than TIFF (CR3, RAF),
the exposure read by LibRaw or EXIF readers. Makers' notes are not copied: they contain offsets into their own file.
Source: TIFF 6.0, section 2; EXIF 2.32, section 4.6.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from drivers.tiff import EXIF, Entry, rational, short, text
from procedures.raw import Exposure, RawFrame, read_photograph

SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 1, 7: 1, 8: 2, 9: 4, 10: 4, 11: 4, 12: 8}
"""Bytes of a number of each type; types 5 and 10 are two."""
PAIRS = (5, 10)
PICTURE = (271, 272, 274, 282, 283, 296, 306, 315, 33432)
"""Tags of the first directory: maker, model, orientation, resolution, date, artist, copyright."""
COLOUR = (50708, 50721, 50722, 50727, 50728, 50730, 50735, 50778, 50779, 50931, 50932, 50936, 50964, 50965)
"""Tags of a DNG: camera name, colour matrices, balance, exposure, serial number, illuminants, profile."""
EXCLUDED = (37500, 40965)
"""Tags of EXIF: makers' notes and the interoperability directory."""
MAX_BYTES = 1 << 16


@dataclass(frozen=True)
class CameraMetadata:
    """Entries by tag: of the picture, of its colours in a DNG, and of EXIF."""

    picture: Mapping[int, Entry] = field(default_factory=dict)
    colour: Mapping[int, Entry] = field(default_factory=dict)
    exif: Mapping[int, Entry] = field(default_factory=dict)


def metadata_of(frame: RawFrame) -> CameraMetadata:
    """The metadata of a photograph's file. Raises BadInput if it can no longer be read."""
    exif = frame.development.exif if frame.development else b""
    return read_metadata(exif.removeprefix(b"Exif\0\0") or read_photograph(frame.path), frame.exposure)


def read_metadata(data: bytes, exposure: Exposure) -> CameraMetadata:
    """The metadata in a file's content; without directories, those of the exposure."""
    try:
        part = _tiff_part(data)
        order = {b"II*\0": "<", b"MM\0*": ">"}[part[:4]]
        first = dict(_entries(part, order, struct.unpack_from(order + "I", part, 4)[0]))
        at = int.from_bytes(first[EXIF][2][:4], "little") if EXIF in first else 0
        exif = dict(_entries(part, order, at)) if at else {}
    except (struct.error, KeyError, IndexError):
        first, exif = {}, {}
    camera = {} if exposure.camera is None else {272: text(exposure.camera)}
    picture = {tag: first[tag] for tag in PICTURE if tag in first}
    colour = {tag: first[tag] for tag in COLOUR if tag in first}
    exif = {tag: entry for tag, entry in exif.items() if tag not in EXCLUDED}
    numbers = {
        33434: exposure.exposure_s,
        33437: exposure.f_number,
        37386: exposure.focal_length_mm,
        37382: exposure.subject_distance_mm and exposure.subject_distance_mm / 1000,
    }
    entries = {tag: rational(value) for tag, value in numbers.items() if value}
    if exposure.iso:
        entries[34855] = short(min(round(exposure.iso), 65535))
    if exposure.lens:
        entries[42036] = text(exposure.lens)
    if exposure.captured_at:
        entries[36867] = text(exposure.captured_at.replace("-", ":").replace("T", " "))
    return CameraMetadata({**camera, **picture}, colour, {**entries, **exif})


def exposure_of(frames: Sequence[RawFrame]) -> Exposure | None:
    """The common exposure of photographs, with fields None where they differ; None without photographs."""
    if not frames:
        return None
    names = ("camera", "lens", "f_number", "focal_length_mm", "subject_distance_mm")
    exposures = [asdict(frame.exposure) for frame in frames]
    same = {name: {exposure[name] for exposure in exposures} for name in names}
    return Exposure(**{name: next(iter(values)) for name, values in same.items() if len(values) == 1})


def _tiff_part(data: bytes) -> bytes:
    """The part of a file in TIFF layout: all of it, or a PNG's eXIf chunk."""
    at = data.find(b"eXIf") if data[:4] == b"\x89PNG" else -1
    return data[at + 4 :] if at >= 0 else data


def _entries(data: bytes, order: str, at: int) -> Iterator[tuple[int, Entry]]:
    """The entries of the directory at an offset, with little-endian numbers."""
    (count,) = struct.unpack_from(order + "H", data, at)
    for i in range(count):
        tag, kind, n = struct.unpack_from(order + "HHI", data, at + 2 + 12 * i)
        size = SIZES.get(kind, 0) * n * (2 if kind in PAIRS else 1)
        if not 0 < size <= MAX_BYTES:
            continue
        place = at + 10 + 12 * i
        if size > 4:
            (place,) = struct.unpack_from(order + "I", data, place)
        raw = data[place : place + size]
        if len(raw) == size:
            little = raw if order == "<" else np.frombuffer(raw, np.uint8).reshape(-1, SIZES[kind])[:, ::-1].tobytes()
            yield tag, (kind, n, little)
