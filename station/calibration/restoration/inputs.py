"""Input files of a restoration: shapes, measured PSFs and fields, records of motion."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, BadParameter
from procedures.raw import ImuRecord
from procedures.reading.arrays import checked_array, read_npy
from procedures.reading.text import read_json, read_numbers, read_rows
from procedures.restoration.masks import blur_models
from procedures.restoration.masks.camera_motion import FLIPPED, Poses, poses_at, poses_of
from procedures.restoration.masks.psf_shapes import measured_field, measured_heights, measured_shape
from procedures.restoration.masks.shape_fields import ShapeField, symmetric
from procedures.restoration.photograph_blur import Shape
from station.results.exports import csv_columns

Size = tuple[int, int]

COLUMNS = ("t_s", "ax", "ay", "az", "wx", "wy", "wz")
"""Columns of an IMU's record: seconds from the opening of the shutter; m/s^2 with gravity and rad/s, x right, y up, z
back."""
MOST_SAMPLES_PER_PX = 1000
"""Largest sampling accepted for a measured PSF."""
POSE_COLUMNS = ("t_s", "x", "y", "z", "rx", "ry", "rz")
"""Columns of poses: seconds, the first row at the opening of the shutter and the last at its closing; metres and
rotation vectors in radians relative to the rig at rest, x right, y up, z back."""
RADIAL = "radial:"
ANY_SIZE = (240, 320)
"""Frame size for a check that a lens's file is readable."""
FIELD_SUFFIXES = (".h5", ".hdf5")


def read_imu(path: Path) -> ImuRecord:
    """An IMU's record from a CSV file with the columns `COLUMNS`, named in its first row; `#` begins a comment. Raises
    BadInput if it cannot be read, a column is missing, or a row does not hold numbers."""
    values = _table(path, COLUMNS)
    return ImuRecord(values[:, 0], values[:, 1:4], values[:, 4:])


def read_poses(path: Path) -> Poses:
    """Read the camera's poses during an exposure from a CSV file with the columns `POSE_COLUMNS`, named in its first
    row.

    Raises BadInput if it cannot be read, a column is missing, a row does not hold numbers, there are fewer than two
    rows, or times do not increase.
    """
    values = _table(path, POSE_COLUMNS)
    return poses_at(values[:, 0], values[:, 1:4], values[:, 4:])


def _table(path: Path, columns: Sequence[str]) -> Array:
    lines = read_rows(path, f"give a CSV file of {','.join(columns)}")
    rows = [
        (n, row)
        for n, row in enumerate(lines, start=1)
        if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")
    ]
    names = [name.strip() for name in rows[0][1]] if rows else []
    lacking = [name for name in columns if name not in names]
    if lacking:
        raise BadInput(f"{path} has no column {', '.join(lacking)}", f"name them in its first row: {','.join(columns)}")
    at = [names.index(name) for name in columns]
    return np.array([_numbers(path, n, row, at) for n, row in rows[1:]], dtype=np.float64).reshape(-1, len(columns))


def _numbers(path: Path, n: int, row: list[str], at: list[int]) -> list[float]:
    try:
        numbers = [float(row[k]) for k in at]
    except (ValueError, IndexError):
        numbers = []
    if not numbers or not all(map(math.isfinite, numbers)):
        reason = f"{path}, row {n}: {len(at)} finite numbers are needed; got {','.join(row)[:200]!r}"
        raise BadInput(reason, "drop the row, or export again")
    return numbers


def imu_table(imu: ImuRecord) -> bytes:
    """A record as `read_imu` takes it."""
    rows = np.column_stack([imu.time_s, imu.acceleration_m_s2, imu.rotation_rad_s])
    return csv_columns(dict(zip(COLUMNS, rows.T, strict=True)), 7)


def poses_table(poses: Poses, exposure_s: float) -> bytes:
    """Poses in the format of `read_poses`."""
    t = np.linspace(0, exposure_s, len(poses.position_m))
    rows = np.column_stack([t, poses.position_m * FLIPPED, poses.turn_rad * FLIPPED])
    return csv_columns(dict(zip(POSE_COLUMNS, rows.T, strict=True)), 9)


def poses_of_records(
    files: Sequence[Path], exposures_s: Sequence[float | None], late_s: float = 0.0
) -> tuple[Poses, ...]:
    """Poses of the camera, from an IMU's record of each exposure, whose times are late by `late_s`.

    exposures_s : of each photograph; None if neither camera nor operator stated it
    """
    if any(one is None for one in exposures_s):
        raise BadParameter("the photographs do not record their exposure time", "give --exposure-s")
    each = zip(files, exposures_s, strict=True)
    return tuple(poses_of(read_imu(file), float(one or 0), late_s) for file, one in each)


def read_blur_shape(name: str, plane: str | None, shape: Size | None, samples_per_px: int | None = None) -> Shape:
    """A shape over photographs (H, W): a model by its name, one from a file, or a measured PSF or field.

    plane, shape : of the photographs; None for the first of a field, and its size
    samples_per_px : sampling if a text file is a measured PSF; None for a shape on [-1, 1]
    """
    if name.startswith(RADIAL):
        return _radial(files_in(name), shape or ANY_SIZE, samples_per_px)
    model = blur_models.named(name)
    if model is not None:
        return model
    path = Path(name)
    if path.suffix.lower() in FIELD_SUFFIXES:
        field = _field(path, plane)
        return measured_field(field, shape or (int(field.shape[0]), int(field.shape[1])))
    if samples_per_px is None and (what := _estimated(path)):
        return _result_array(path, what)
    psf = _psf(path, samples_per_px)
    return blur_models.read_shape(path) if psf is None else measured_shape(*psf)


def read_kernels(paths: Sequence[Path]) -> tuple[tuple[Array, ...], str | None]:
    """Kernels of one sample a pixel from a restoration's kernel_N.npy or text files, and the caveat in its record."""
    kernels = []
    for path in paths:
        kernels.append(_result_array(path, "kernel") if path.suffix.lower() == ".npy" else blur_models.read_shape(path))
    return tuple(kernels), caveat_of([str(path) for path in paths])


def caveat_of(names: Sequence[str]) -> str | None:
    """The caveat in the records of the restorations that estimated kernels or shapes; None if there is none."""
    estimated = [path for path in map(Path, names) if _estimated(path)]
    motions = [_record_of(path).get("parameters", {}).get("motion", {}) for path in estimated]
    caveats = (motion.get("caveat", motion.get("doubt")) for motion in motions)  # older records have the second key
    return next((str(caveat) for caveat in caveats if caveat), None)


def _result_array(path: Path, what: str) -> Array:
    return blur_models.check_shape(read_npy(path, what, f"give a {what}_N.npy of a result"), str(path))


def _estimated(path: Path) -> str:
    """Whether the file is the "kernel" or the "shape" of a motion that a restoration estimated; else empty."""
    what = path.stem.partition("_")[0]
    named = path.suffix.lower() == ".npy" and what in ("kernel", "shape") and path.stem != what
    return what if named and f"{what}s" in _record_of(path) else ""


def _record_of(path: Path) -> dict[str, Any]:
    try:
        record = read_json(path.parent / "result.json")
    except BadInput:
        return {}
    return record if isinstance(record, dict) else {}


def _psf(path: Path, samples_per_px: int | None) -> tuple[Array, int] | None:
    """A measured PSF and its samples per pixel; None if the file is a shape."""
    if path.suffix.lower() == ".npy":
        array = checked_array(read_npy(path, "PSF", _GIVE_PSF), str(path), remedy=_GIVE_PSF)
        return array, samples_per_px or _samples_of(path)
    return None if samples_per_px is None else (read_numbers(path, "PSF file"), samples_per_px)


def _radial(names: Sequence[str], shape: Size, samples_per_px: int | None) -> ShapeField:
    """The field of a lens symmetric about its axis from shapes or PSFs at equal heights, centre to corner (4.20)."""
    psfs = [one for one in (_psf(Path(name), samples_per_px) for name in names) if one is not None]
    if not psfs:
        return symmetric([blur_models.read_shape(Path(name)) for name in names], shape)
    if len(psfs) < len(names) or len({samples for _, samples in psfs}) > 1:
        raise BadParameter(
            "all must be shapes, or PSFs of one sampling, to be of one lens", "give PSFs of one sampling, or shapes"
        )
    return measured_heights([h for h, _ in psfs], psfs[0][1], shape)


def _field(path: Path, plane: str | None) -> Any:
    from procedures.field.field_file import read_field

    fields = read_field(path)
    if plane is None:
        return next(iter(fields.values()))
    if plane not in fields:
        raise BadInput(f"{path} has the planes {', '.join(fields)}, not {plane}", "restore one of these: --plane")
    return fields[plane]


def files_in(name: str) -> list[str]:
    """The files in the option of a shape or record."""
    return name.removeprefix(RADIAL).split(",") if name.startswith(RADIAL) else [name]


def with_files(name: str, files: Sequence[str]) -> str:
    """The option with as many other files."""
    return f"{RADIAL}{','.join(files)}" if name.startswith(RADIAL) else files[0]


def with_record(path: Path) -> list[Path]:
    """A file, and the record of an array from a result."""
    record = path.parent / "result.json"
    return [path, record] if path.suffix.lower() == ".npy" and record.exists() else [path]


def _samples_of(path: Path) -> int:
    """Samples per pixel of a result's PSF, from the record in its folder. Raises BadParameter if there is none."""
    try:
        record = read_json(path.parent / "result.json")
        plane = record.get("planes", {}).get(path.stem.removeprefix("psf_"), {})
        samples = plane.get("s") or record["parameters"]["s"]
    except (BadInput, KeyError, TypeError, AttributeError) as error:
        raise BadParameter(f"{path} {_NO_SAMPLES}", _GIVE_SAMPLES) from error
    if type(samples) is not int or not 1 <= samples <= MOST_SAMPLES_PER_PX:
        raise BadParameter(f"{path} {_NO_SAMPLES}", _GIVE_SAMPLES)
    return samples


_GIVE_PSF = "give a psf_P.npy of a result"
_GIVE_SAMPLES = "give the file in its result's folder; the command takes --samples-per-pixel"
_NO_SAMPLES = "has no result.json in its folder that states its samples per pixel"
