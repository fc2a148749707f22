"""What blurred the photographs of a restoration, from files: shapes, measured PSFs and fields, records of motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, BadParameter
from procedures.raw import Felt
from procedures.reading.arrays import check_real, read_npy
from procedures.reading.text import read_json, read_numbers, read_rows
from procedures.restoration.joint.kernel_sizes import BEYOND, default_max_w, fitting_ratios, stacks_of
from procedures.restoration.masks import blur_models
from procedures.restoration.masks.blur_models import Unit, reach
from procedures.restoration.masks.camera_motion import FLIPPED, Poses, motion_blur, poses_at, poses_of
from procedures.restoration.masks.checks import check_extent
from procedures.restoration.masks.defocus_and_motion import with_defocus
from procedures.restoration.masks.mask_fields import Masks
from procedures.restoration.masks.psf_shapes import MeasuredShape, measured_field, measured_heights, measured_shape
from procedures.restoration.masks.shape_fields import ShapeField, symmetric
from procedures.restoration.unknown_motion.path_refinement import MotionShapes

Array = npt.NDArray[np.float64]
Pictures = npt.NDArray[np.floating[Any]]
Size = tuple[int, int]

COLUMNS = ("t_s", "ax", "ay", "az", "wx", "wy", "wz")
"""Of an IMU's record: seconds from the opening of the shutter; m/s^2 with gravity and rad/s, x right, y up, z back."""
MOST_SAMPLES_PER_PX = 1000
"""Of a measured PSF, whoever measured it."""
POSE_COLUMNS = ("t_s", "x", "y", "z", "rx", "ry", "rz")
"""Of a record of poses: seconds, the first row at the opening of the shutter and the last at its closing; metres and
rotation vectors in radians from where the rig rests, x right, y up, z back."""
RADIAL = "radial:"
FIELD_SUFFIXES = (".h5", ".hdf5")


@dataclass(frozen=True)
class BlurInput:
    """Masks of each photograph, what their w is told in, what the record says of them, and the motion found, if any.

    finer : the same masks where pixels are n times as fine along each axis, and w counts in those.
    """

    masks: Sequence[Masks]
    unit: Unit = field(default_factory=Unit)
    told: dict[str, Any] = field(default_factory=dict)
    motion: MotionShapes | None = None
    finer: Callable[[int], Sequence[Masks]] | None = None


# --- records of an IMU -------------------------------------------------------------------------------------------


def read_imu(path: Path) -> Felt:
    """An IMU's record from a CSV file with the columns `COLUMNS`, named in its first row; `#` begins a comment.

    Raises
    ------
    BadInput
        If it cannot be read, a column lacks, or a row does not hold numbers.
    """
    values = _table(path, COLUMNS)
    return Felt(values[:, 0], values[:, 1:4], values[:, 4:])


def read_poses(path: Path) -> Poses:
    """Where the camera was during an exposure, from a CSV file with the columns `POSE_COLUMNS`, named in its first row.

    Raises
    ------
    BadInput
        If it cannot be read, a column lacks, a row does not hold numbers, there are fewer than two rows, or times do
        not increase.
    """
    values = _table(path, POSE_COLUMNS)
    return poses_at(values[:, 0], values[:, 1:4], values[:, 4:])


def _table(path: Path, columns: Sequence[str]) -> Array:
    """The named columns of a CSV file, (rows, columns)."""
    lines = read_rows(path, f"give a CSV file of {','.join(columns)}")
    rows = [(n, row) for n, row in enumerate(lines, start=1) if _counts(row)]
    names = [name.strip() for name in rows[0][1]] if rows else []
    lacking = [name for name in columns if name not in names]
    if lacking:
        raise BadInput(f"{path} has no column {', '.join(lacking)}", f"name them in its first row: {','.join(columns)}")
    at = [names.index(name) for name in columns]
    return np.array([_numbers(path, n, row, at) for n, row in rows[1:]], dtype=np.float64).reshape(-1, len(columns))


def _counts(row: list[str]) -> bool:
    return any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")


def _numbers(path: Path, n: int, row: list[str], at: list[int]) -> list[float]:
    try:
        numbers = [float(row[k]) for k in at]
    except (ValueError, IndexError):
        numbers = []
    if not numbers or not all(map(math.isfinite, numbers)):
        reason = f"{path}, row {n}: {len(at)} finite numbers are needed; got {','.join(row)[:200]!r}"
        raise BadInput(reason, "drop the row, or export again")
    return numbers


def imu_table(felt: Felt) -> bytes:
    """A record as `read_imu` takes it."""
    rows = np.column_stack([felt.time_s, felt.acceleration_m_s2, felt.rotation_rad_s])
    lines = [",".join(COLUMNS), *(",".join(f"{value:.7g}" for value in row) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def poses_table(poses: Poses, exposure_s: float) -> bytes:
    """Poses as `read_poses` takes them."""
    t = np.linspace(0, exposure_s, len(poses.position_m))
    rows = np.column_stack([t, poses.position_m * FLIPPED, poses.turn_rad * FLIPPED])
    lines = [",".join(POSE_COLUMNS), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def from_imu_records(
    files: Sequence[Path],
    exposures_s: Sequence[float | None],
    focal_px: float,
    max_inverse_m: float,
    shape: Size,
) -> BlurInput:
    """Masks over the frame from the records of all exposures; w is the inverse depth.

    exposures_s : of each photograph; None where neither camera nor operator told
    """
    if any(one is None for one in exposures_s):
        raise BadParameter("the photographs do not tell their exposure time", "give --exposure-s")
    poses = [poses_of(read_imu(file), float(one or 0)) for file, one in zip(files, exposures_s, strict=True)]
    given = {"imu": [str(one) for one in files], "exposure_s": list(exposures_s)}
    return _moved(poses, focal_px, max_inverse_m, shape, given)


def from_poses(files: Sequence[Path], focal_px: float, max_inverse_m: float, shape: Size) -> BlurInput:
    """Masks over the frame from where the camera was during all exposures (5.1, 5.2); w is the inverse depth."""
    given = {"poses": [str(one) for one in files]}
    return _moved([read_poses(one) for one in files], focal_px, max_inverse_m, shape, given)


def _moved(
    poses: Sequence[Poses], focal_px: float, max_inverse_m: float, shape: Size, given: dict[str, Any]
) -> BlurInput:
    blur = motion_blur(poses, focal_px, shape, max_inverse_m)
    told = {**given, "focal_px": focal_px, "max_inverse_depth": max_inverse_m}
    told |= {"nodes": list(blur.fields[0].grid), "half_size": blur.fields[0].R}

    def finer(n: int) -> Sequence[Masks]:
        return motion_blur(poses, n * focal_px, (n * shape[0], n * shape[1]), max_inverse_m).fields

    return BlurInput(blur.fields, blur.unit, told, finer=finer)


# --- shapes ------------------------------------------------------------------------------------------------------


def from_shapes(
    names: Sequence[str],
    ratios: Sequence[float],
    max_w: float | None,
    photographs: Sequence[Pictures],
    *,
    plane: str = "Y",
    samples_per_px: int | None = None,
    offsets: Sequence[float] = (),
) -> BlurInput:
    """Masks from one shape for each photograph: a model's name, a shape file, or a measured PSF or field.

    ratios, offsets : w of each photograph is ratio times the first's plus offset, in pixels; none: 1 and 0, but of
    measured ones the ratio of their half-widths.
    photographs : (C, H, W) each; samples_per_px : a text file is a measured PSF sampled so, not a shape on [-1, 1].
    """
    found = [_shape(name, plane, _size(photographs), samples_per_px) for name in names]
    return from_arrays(found, ratios, max_w, photographs, offsets)


def from_arrays(
    found: Sequence[Array | ShapeField],
    ratios: Sequence[float],
    max_w: float | None,
    photographs: Sequence[Pictures],
    offsets: Sequence[float] = (),
) -> BlurInput:
    """Masks from one shape for each photograph, as it is at hand."""
    drawn = [one for one in found if not isinstance(one, ShapeField)]
    measured = [one for one in found if isinstance(one, MeasuredShape)]
    widest = max_w or max([default_max_w(drawn), *(one.half_width_px + 1 for one in measured)])
    by = tuple(offsets) or (0.0,) * len(found)
    if ratios:
        each = tuple(ratios)
    elif len(drawn) < len(found) or any(by):
        each = tuple(_ratio(found[0], one) for one in found)
    else:
        each = fitting_ratios(photographs, drawn, widest)
    rows, columns = _size(photographs)

    def finer(n: int) -> Sequence[Masks]:
        shifts, shape = [n * one for one in by], (n * rows, n * columns)
        if len(drawn) == len(found):
            return stacks_of(drawn, each, n * widest + (n - 1) * BEYOND, shape, shifts)
        return _field_masks(found, each, shifts, n * widest, shape)

    told: dict[str, Any] = {"ratio": list(each[1:]), "max_w": widest}
    if any(by):
        told["offset"] = list(by[1:])
    if measured:
        told["measured"] = [_told_of(one) for one in measured]
    return BlurInput(finer(1), told=told, finer=finer)


def spread_by_defocus(
    motion: BlurInput,
    names: Sequence[str],
    ratios: Sequence[float],
    offsets: Sequence[float],
    photographs: Sequence[Pictures],
    plane: str,
) -> BlurInput:
    """The blur of motion, and of defocus at the same time: of half-width ratio times w plus offset, in pixels.

    names : shape of each photograph's defocus, as `from_shapes` takes them; ratios : pixels for a unit of w as told.
    """
    shapes = [_shape(name, plane, _size(photographs), None) for name in names]
    fields = [one if isinstance(one, ShapeField) else ShapeField(((one,),)) for one in shapes]
    slopes = [one * motion.unit.per_pixel for one in ratios]

    def finer(n: int, of: Sequence[Masks]) -> Sequence[Masks]:
        masks = with_defocus(of, fields, slopes, [n * one for one in offsets])
        check_extent(masks[0].R, (n * photographs[0].shape[1], n * photographs[0].shape[2]))
        return masks

    told = {"defocus_shape": list(names), "defocus_ratio": list(ratios), "defocus_offset": list(offsets)}
    of = motion.finer
    return replace(
        motion,
        masks=finer(1, motion.masks),
        told={**motion.told, **told},
        finer=None if of is None else lambda n: finer(n, of(n)),
    )


def _size(photographs: Sequence[Pictures]) -> Size:
    return int(photographs[0].shape[1]), int(photographs[0].shape[2])


def _told_of(one: MeasuredShape) -> dict[str, Any]:
    """What the record says of a measured shape."""
    light = {"negative_light": one.cut, "energy_outside_support": one.energy_outside_support}
    return {"half_width_px": one.half_width_px, **light}


def _field_masks(
    found: Sequence[Array | ShapeField], ratios: Sequence[float], offsets: Sequence[float], max_w: float, shape: Size
) -> list[Masks]:
    """Masks of shapes of which some are measured or vary over the frame."""
    R = max(reach(max_w, ratio, offset) for ratio, offset in zip(ratios, offsets, strict=True))
    check_extent(R, shape)
    return [
        one.masks(max_w, R, ratio, offset)
        if isinstance(one, ShapeField)
        else blur_models.mask_stack(one, max_w, ratio=ratio, offset=offset, R=R)
        for one, ratio, offset in zip(found, ratios, offsets, strict=True)
    ]


def _ratio(first: Array | ShapeField, other: Array | ShapeField) -> float:
    if isinstance(first, MeasuredShape) and isinstance(other, MeasuredShape):
        return other.half_width_px / first.half_width_px
    return 1.0


def _shape(name: str, plane: str, shape: Size, samples_per_px: int | None) -> Array | ShapeField:
    if name.startswith(RADIAL):
        return _radial(name.removeprefix(RADIAL).split(","), shape, samples_per_px)
    known = blur_models.named(name)
    if known is not None:
        return known
    path = Path(name)
    if path.suffix.lower() in FIELD_SUFFIXES:
        return measured_field(_field(path, plane), shape)
    psf = _psf(path, samples_per_px)
    return blur_models.read_shape(path) if psf is None else measured_shape(*psf)


def _psf(path: Path, samples_per_px: int | None) -> tuple[Array, int] | None:
    """A measured PSF and its samples per pixel; None where the file is a shape."""
    if path.suffix.lower() == ".npy":
        array = read_npy(path, "PSF", "give a psf_P.npy of a result")
        check_real(array, str(path))
        return np.asarray(array, np.float64), samples_per_px or _samples_beside(path)
    return None if samples_per_px is None else (read_numbers(path, "PSF file"), samples_per_px)


def _radial(names: Sequence[str], shape: Size, samples_per_px: int | None) -> ShapeField:
    """What a lens symmetric about its axis makes of shapes or PSFs at equal heights, middle to corner (4.20)."""
    psfs = [one for one in (_psf(Path(name), samples_per_px) for name in names) if one is not None]
    if not psfs:
        return symmetric([blur_models.read_shape(Path(name)) for name in names], shape)
    if len(psfs) < len(names) or len({samples for _, samples in psfs}) > 1:
        raise BadParameter(
            "PSFs and shapes, or PSFs of different sampling, are no one lens", "give PSFs of one sampling, or shapes"
        )
    return measured_heights([h for h, _ in psfs], psfs[0][1], shape)


def _field(path: Path, plane: str) -> Any:
    from procedures.field.field_file import read_field

    fields = read_field(path)
    if plane not in fields:
        raise BadInput(f"{path} has the planes {', '.join(fields)}, not {plane}", "restore one of these: --plane")
    return fields[plane]


def _samples_beside(path: Path) -> int:
    """Samples per pixel of a result's PSF, from the record in its folder. Raises BadParameter if there is none."""
    try:
        record = read_json(path.parent / "result.json")
        plane = record.get("planes", {}).get(path.stem.removeprefix("psf_"), {})
        found = plane.get("s") or record["parameters"]["s"]
    except (BadInput, KeyError, TypeError, AttributeError) as error:
        raise BadParameter(f"{path} {_NO_SAMPLES}", "give --samples-per-pixel") from error
    if type(found) is not int or not 1 <= found <= MOST_SAMPLES_PER_PX:
        raise BadParameter(f"{path} {_NO_SAMPLES}", "give --samples-per-pixel")
    return found


_NO_SAMPLES = "has no result.json beside it that tells its samples per pixel"
