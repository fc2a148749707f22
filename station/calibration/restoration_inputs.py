"""What blurred the photographs of a restoration, from files: shapes, measured PSFs and fields, records of an IMU."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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
from procedures.restoration.masks.blur_models import Unit
from procedures.restoration.masks.camera_motion import motion_blur, poses_of
from procedures.restoration.masks.checks import check_extent
from procedures.restoration.masks.mask_fields import Masks
from procedures.restoration.masks.psf_shapes import MeasuredShape, measured_field, measured_shape
from procedures.restoration.unknown_motion.path_refinement import MotionShapes

Array = npt.NDArray[np.float64]
Pictures = npt.NDArray[np.floating[Any]]
Size = tuple[int, int]

COLUMNS = ("t_s", "ax", "ay", "az", "wx", "wy", "wz")
"""Of an IMU's record: seconds from the opening of the shutter; m/s^2 with gravity and rad/s, x right, y up, z back."""
MOST_SAMPLES_PER_PX = 1000
"""Of a measured PSF, whoever measured it."""
POLYGON = "polygon:"
MOST_BLADES = 64
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
    lines = read_rows(path, f"give a CSV file of {','.join(COLUMNS)}")
    rows = [(n, row) for n, row in enumerate(lines, start=1) if _counts(row)]
    names = [name.strip() for name in rows[0][1]] if rows else []
    lacking = [name for name in COLUMNS if name not in names]
    if lacking:
        raise BadInput(f"{path} has no column {', '.join(lacking)}", f"name them in its first row: {','.join(COLUMNS)}")
    at = [names.index(name) for name in COLUMNS]
    values = np.array([_numbers(path, n, row, at) for n, row in rows[1:]], dtype=np.float64).reshape(-1, len(COLUMNS))
    return Felt(values[:, 0], values[:, 1:4], values[:, 4:])


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
    blur = motion_blur(poses, focal_px, shape, max_inverse_m)
    told = {"imu": [str(one) for one in files], "exposure_s": list(exposures_s), "focal_px": focal_px}
    told |= {"max_inverse_depth": max_inverse_m, "nodes": list(blur.fields[0].grid), "half_size": blur.fields[0].R}

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
) -> BlurInput:
    """Masks from one shape for each photograph: a model's name, a shape file, or a measured PSF or field.

    ratios : w of each photograph over the first's; none: 1, but of measured ones their half-widths' ratio.
    photographs : (C, H, W) each; samples_per_px : a text file is a measured PSF sampled so, not a shape on [-1, 1].
    """
    shape = (photographs[0].shape[1], photographs[0].shape[2])
    return from_arrays([_shape(name, plane, shape, samples_per_px) for name in names], ratios, max_w, photographs)


def from_arrays(
    found: Sequence[Array | MeasuredShape],
    ratios: Sequence[float],
    max_w: float | None,
    photographs: Sequence[Pictures],
) -> BlurInput:
    """Masks from one shape for each photograph, as it is at hand."""
    drawn = [one for one in found if not isinstance(one, MeasuredShape)]
    measured = [one for one in found if isinstance(one, MeasuredShape)]
    widest = max_w or max([default_max_w(drawn), *(one.half_width_px + 1 for one in measured)])
    shape = (photographs[0].shape[1], photographs[0].shape[2])
    if not measured:
        each = tuple(ratios) or fitting_ratios(photographs, drawn, widest)

        def finer(n: int) -> Sequence[Masks]:
            return stacks_of(drawn, each, n * widest + (n - 1) * BEYOND, (n * shape[0], n * shape[1]))

        return BlurInput(finer(1), told={"ratio": list(each[1:]), "max_w": widest}, finer=finer)
    each = tuple(ratios) or tuple(_ratio(found[0], one) for one in found)

    def of_measured(n: int) -> Sequence[Masks]:
        return _measured_masks(found, each, n * widest, (n * shape[0], n * shape[1]))

    told: dict[str, Any] = {"ratio": list(each[1:]), "max_w": widest}
    told["measured"] = [
        {
            "half_width_px": one.half_width_px,
            "negative_light": one.cut,
            "energy_outside_support": one.energy_outside_support,
        }
        for one in measured
    ]
    return BlurInput(of_measured(1), told=told, finer=of_measured)


def _measured_masks(
    found: Sequence[Array | MeasuredShape], ratios: Sequence[float], max_w: float, shape: Size
) -> list[Masks]:
    """Masks of shapes of which some were measured."""
    R = int(np.ceil(max_w * max(ratios) + 0.5))
    check_extent(R, shape)
    return [
        one.masks(max_w, R, ratio)
        if isinstance(one, MeasuredShape)
        else blur_models.mask_stack(one, max_w, ratio=ratio, R=R)
        for one, ratio in zip(found, ratios, strict=True)
    ]


def _ratio(first: Array | MeasuredShape, other: Array | MeasuredShape) -> float:
    if isinstance(first, MeasuredShape) and isinstance(other, MeasuredShape):
        return other.half_width_px / first.half_width_px
    return 1.0


def _shape(name: str, plane: str, shape: Size, samples_per_px: int | None) -> Array | MeasuredShape:
    if name == "pillbox":
        return blur_models.pillbox()
    if name == "gaussian":
        return blur_models.gaussian()
    if name.startswith(POLYGON):
        return _polygon(name)
    path = Path(name)
    if path.suffix.lower() in FIELD_SUFFIXES:
        return measured_field(_field(path, plane), shape)
    if path.suffix.lower() == ".npy":
        array = read_npy(path, "PSF", "give a psf_P.npy of a result")
        check_real(array, str(path))
        return measured_shape(np.asarray(array, np.float64), samples_per_px or _samples_beside(path))
    if samples_per_px is not None:
        return measured_shape(read_numbers(path, "PSF file"), samples_per_px)
    return blur_models.read_shape(path)


def _polygon(name: str) -> Array:
    """The aperture of a diaphragm with straight blades: "polygon:7", or "polygon:7:15" turned by 15 degrees."""
    blades, _, turned = name.removeprefix(POLYGON).partition(":")
    try:
        count, angle = int(blades), float(turned or 0.0)
    except ValueError as error:
        reason = f"a polygon is told by its blades and its turn in degrees; got {name!r}"
        raise BadParameter(reason, 'write it like "polygon:7" or "polygon:7:15"') from error
    if not math.isfinite(angle) or count > MOST_BLADES:
        reason = f"a polygon has 3 to {MOST_BLADES} blades and a finite turn; got {name!r}"
        raise BadParameter(reason, "count the diaphragm's blades; where they are many, pillbox is the same")
    return blur_models.polygon(count, math.radians(angle))


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
