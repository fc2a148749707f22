"""Settings of a restoration: the blur and its files, the descent, the camera's data for metres; their consistency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec

from procedures.outcome import BadParameter
from station.procedure.base import PictureSettings, setting

if TYPE_CHECKING:
    from procedures.restoration.joint.estimate import RestorationParameters

NAME = "{name}"
"""Placeholder for the photograph's name without suffix; such files are in its folder."""
OF_FILES = ("shape", "defocus_shape", "recorded_path", "imu", "poses")
DESCENT = ("image_weight", "depth_weight", "scheme", "depth_start", "symmetric_axis", "total_variation",
           "depth_total_variation")  # fmt: skip
SEE = "see `station restore --help`"

Texts = tuple[str, ...]


class RestoreSettings(PictureSettings, frozen=True, kw_only=True):
    """The cause of the blur, the descent, and what is known of the camera."""

    blur: Annotated[Literal["defocus", "motion", "both"], setting("Cause of the blur.")]
    shape: Annotated[Texts, setting(
        "pillbox, gaussian[:K], polygon:BLADES[:DEGREES], text arrays, psf_P.npy, kernel_N.npy or field.h5 of a "
        "result, or radial:FILE,FILE,... for a lens symmetric about its axis, centre to corner: one, or one for "
        "each image. With --prototype-region whole, kernels from an earlier result.")] = ()  # fmt: skip
    samples_per_pixel: (
        Annotated[int, setting("Sampling if the shapes are PSFs, not on [-1, 1].", least=1, most=1000)]
        | Literal["auto"]
    ) = "auto"
    ratio: Annotated[
        tuple[float, ...],
        setting("w of photograph 2 (3, ...) over w of 1.  [default: 1, or the ratio of measured kernels' sizes]"),
    ] = ()
    offset: Annotated[
        tuple[float, ...], setting("Offset of w of photograph 2 (3, ...) in pixels, from another focus.  [default: 0]")
    ] = ()
    defocus_shape: Annotated[
        Texts,
        setting("With --blur both, where --shape is that of motion: the aperture's shape, one or one for each image."),
    ] = ()
    defocus_ratio: Annotated[
        tuple[float, ...], setting("Half-width of that defocus in pixels per unit of w, one or one for each image.")
    ] = ()
    defocus_offset: Annotated[tuple[float, ...], setting(
        "Half-width of that defocus at w = 0, pixels; negative for a plane of focus within the scene.  [default: 0]"
    )] = ()  # fmt: skip
    max_w: Annotated[
        float | None,
        setting("Largest half-width of blur, pixels of image 1.  [default: 8, or a measured kernel's plus one]"),
    ] = None
    image_weight: Annotated[float | None, setting("lambda_u.  [default: from the noise]")] = None
    depth_weight: Annotated[float | None, setting("lambda_w, of the bending of w.  [default: from the noise]")] = None
    scheme: Annotated[str, setting("Rounds of picture and depth, then picture.")] = "20x(20+20)+5x20"
    depth_start: Annotated[Literal["matched", "symmetric", "blur"], setting("Estimate of the first depth.")] = "matched"
    symmetric_axis: Annotated[
        Literal["both", "x", "y"],
        setting("Axis of symmetry for --depth-start symmetric: both, or that of a uniform motion."),
    ] = "both"
    total_variation: Annotated[bool, setting("Picture prior by total variation instead of Tikhonov.")] = False
    depth_total_variation: Annotated[bool, setting("Prior of w by total variation.")] = False
    prototype_region: Annotated[str | None, setting(
        "Flat part for the estimation of unknown motion; auto searches for one; whole is a flat scene, whose "
        "motions may be of any form, in two images or more.",
        metavar="X,Y,W,H")] = None  # fmt: skip
    recorded_path: Annotated[Texts, setting(
        "Path of the rig during each exposure, two columns x y at equal times: starts the search of its shape.",
        metavar="FILE")] = ()  # fmt: skip
    imu: Annotated[
        Texts,
        setting(
            "Record of each exposure, CSV: t_s,ax,ay,az,wx,wy,wz; s since the shutter opened, m/s², rad/s; x right, "
            "y up.",
            metavar="FILE",
        ),
    ] = ()
    poses: Annotated[Texts, setting(
        "Poses of the camera during each exposure, CSV: t_s,x,y,z,rx,ry,rz; m, rotation vector in rad, axes as "
        "--imu.",
        metavar="FILE")] = ()  # fmt: skip
    focal_px: Annotated[float | None, setting("Focal length in pixels of the plane, for --imu and --poses.")] = None
    max_inverse_depth: Annotated[float | None, setting("1 / the smallest distance in the scene, 1/m, for these.")] = (
        None
    )
    exposure_s: Annotated[tuple[float, ...], setting("Exposure time, for --imu.  [default: as recorded]")] = ()
    imu_within_s: Annotated[
        float, setting("Bound of the error of the records' times, for --imu: one shift within it is fitted.", least=0.0)
    ] = 0.0
    metres: Annotated[Literal["front", "behind"] | None, setting(
        "Give depth in metres: the scene is in front of the plane of focus, or behind it. --ratio and --offset "
        "come from the camera's data.")] = None  # fmt: skip
    f_number: tuple[
        Annotated[
            float, setting("For --metres, one or one for each image.  [default: as recorded]", least=0.5, most=100)
        ],
        ...,
    ] = ()
    focus_m: tuple[
        Annotated[
            float,
            setting(
                "For --metres: distance of the plane of focus from the lens, one or one each.  [default: as recorded]",
                least=0.01,
            ),
        ],
        ...,
    ] = ()
    focal_length_mm: Annotated[float, setting("For --metres.  [default: as recorded]", least=0.1)] | None = None
    pixel_pitch_um: Annotated[float, setting("For --metres: of the sensor's pixels.", least=0.1)] | None = None
    camera_uncertainty: Annotated[float, setting(
        "For --metres: relative standard uncertainty of the focus distance, and of focal length over f-number and "
        "pixel pitch; 0 for calibrated values.",
        least=0, most=0.5)] = 0.01  # fmt: skip
    reference: Annotated[
        Path | None,
        setting("A sharp photograph of the same scene from the same place, with which the result is compared."),
    ] = None

    def placed(self, folder: Path) -> RestoreSettings:
        """The settings with files in a folder; those with `{name}` remain, they are in each photograph's folder."""
        texts = {key: tuple(_placed(name, folder) for name in getattr(self, key)) for key in OF_FILES}
        return msgspec.structs.replace(super().placed(folder), **texts)

    def of(self, photographs: Sequence[Path]) -> RestoreSettings:
        """The settings for these photographs: one file each for a name with `{name}`, and a shape for metres."""
        values: dict[str, Any] = {}
        for key in OF_FILES:
            names = getattr(self, key)
            names = names * len(photographs) if len(names) == 1 and NAME in names[0] else names
            values[key] = tuple(
                _beside(name, photographs[min(i, len(photographs) - 1)]) for i, name in enumerate(names)
            )
        if self.reference is not None:
            values["reference"] = Path(_beside(str(self.reference), photographs[0]))
        if self.metres is not None and not self.shape:
            values["shape"] = ("pillbox",)
        return msgspec.structs.replace(self, **values)

    @property
    def files(self) -> list[Path]:
        """The files that the settings name, with the records of measured PSFs."""
        from station.calibration.restoration.inputs import with_record

        names = [part for key in OF_FILES for name in getattr(self, key) for part in _parts(name)]
        inputs = [file for name in names for file in with_record(Path(name))]
        return list(dict.fromkeys([*inputs, *([self.reference] if self.reference else [])]))

    @property
    def descent(self) -> dict[str, Any]:
        """Parameters of the estimate as a record states them."""
        return {name: getattr(self, name) for name in DESCENT}

    @property
    def parameters(self) -> RestorationParameters:
        """Parameters of the estimate. Raises BadParameter."""
        from procedures.restoration.joint.estimate import RestorationParameters
        from procedures.restoration.joint.schedule import Scheme

        return RestorationParameters(**{**self.descent, "scheme": Scheme.parse(self.scheme)})

    def check(self) -> None:
        """Raise BadParameter if settings are inconsistent for any number of photographs."""
        super().check()
        if "," in (self.plane or ""):
            raise BadParameter(f"a restoration has one plane, or all; got {self.plane}", "give G1, or all for colour")
        each = (self.shape, self.defocus_shape, self.imu, self.poses, (None, *self.ratio), (None, *self.offset))
        count = max(2, *map(len, each))
        self.of([Path()] * count).check_for(count)

    def check_for(self, images: int) -> None:
        """Raise BadParameter if the settings are inconsistent for this number of photographs."""
        if images < 2:
            raise _unfit(f"restoration needs two photographs or more, got {images}")
        _ = self.parameters
        self._check_metres(images)
        if self.max_w is not None:
            from procedures.restoration.masks.checks import check_max_w

            check_max_w(self.max_w)
        if self.recorded_path and (self.prototype_region is None or len(self.recorded_path) != 2):
            raise _unfit("--recorded-path needs --prototype-region, and one path for each of two photographs")
        if self.imu or self.poses:
            self._check_recorded(images)
        elif (self.focal_px, self.max_inverse_depth) != (None, None):
            raise _unfit("--focal-px and --max-inverse-depth go with --imu and --poses")
        elif self.prototype_region is None:
            if len(self.shape) not in (1, images):
                raise _unfit(f"--shape takes one shape, or one for each of {images} images; got {len(self.shape)}")
            for name in self.shape:
                if self.blur != "defocus" and name.partition(":")[0] in ("pillbox", "gaussian", "polygon"):
                    raise _unfit(
                        f"--shape {name} is a blur of --blur defocus; --blur {self.blur} takes text arrays of motion"
                    )
        if self.prototype_region is not None:
            self._check_region(images)
        if (self.exposure_s or self.imu_within_s) and not self.imu:
            raise _unfit(f"{'--exposure-s' if self.exposure_s else '--imu-within-s'} goes with --imu")
        for option, given in (("--ratio", self.ratio), ("--offset", self.offset)):
            if len(given) >= images:
                raise _unfit(f"{option} is for images after the first, here {images - 1}; got {len(given)} values")
        if self.offset and (self.blur != "defocus" or self.prototype_region):
            raise _unfit("--offset goes with --blur defocus: it comes from another focus")
        self._check_defocus(images)

    def _check_metres(self, images: int) -> None:
        if self.metres is None:
            if self.f_number or self.focus_m or self.focal_length_mm or self.pixel_pitch_um:
                raise _unfit("--f-number, --focus-m, --focal-length-mm and --pixel-pitch-um go with --metres")
            return
        models = {one.partition(":")[0] for one in self.shape}
        if self.blur != "defocus" or len(set(self.shape)) > 1 or models - {"pillbox", "gaussian"}:
            raise _unfit(
                "--metres goes with --blur defocus and --shape pillbox or gaussian:K: there w follows from the radius "
                "of the lens's blur circle"
            )
        if self.ratio or self.offset:
            raise _unfit("--metres takes ratio and offset of the blurs from the camera's data")
        _check_counts({"--f-number": self.f_number, "--focus-m": self.focus_m}, images)

    def _check_region(self, images: int) -> None:
        whole = (self.prototype_region or "").strip().lower() == "whole"
        if self.shape and not whole:
            raise _unfit("--shape goes with --prototype-region whole, as kernels found before, or without a region")
        if self.shape and len(self.shape) != images:
            raise _unfit(f"--shape takes one kernel for each of {images} images of a flat scene; got {len(self.shape)}")
        if whole and (self.recorded_path or self.ratio):
            raise _unfit("--prototype-region whole finds every motion by itself, without --recorded-path and --ratio")
        if not whole and images > 2:
            raise _unfit(
                f"a flat part determines the motion of two photographs, not of {images}: give two, "
                "or --prototype-region whole if the whole scene is flat"
            )

    def _check_recorded(self, images: int) -> None:
        option, records = ("--imu", self.imu) if self.imu else ("--poses", self.poses)
        if self.imu and self.poses:
            raise _unfit("give --imu or --poses, not both")
        if self.blur == "defocus" or self.shape or self.ratio or self.prototype_region:
            raise _unfit(f"{option} goes with --blur motion or both, without --shape, --ratio and --prototype-region")
        if len(records) != images:
            raise _unfit(f"{option} takes one record for each of {images} images; got {len(records)}")
        if self.focal_px is None or self.max_inverse_depth is None:
            raise _unfit(f"{option} needs --focal-px and --max-inverse-depth")
        _check_counts({"--exposure-s": self.exposure_s}, images)

    def _check_defocus(self, images: int) -> None:
        each = {
            "--defocus-shape": self.defocus_shape,
            "--defocus-ratio": self.defocus_ratio,
            "--defocus-offset": self.defocus_offset,
        }
        if self.blur != "both":
            if any(each.values()):
                raise _unfit(f"{', '.join(each)} go with --blur both")
            return
        if self.prototype_region:
            raise _unfit("--prototype-region finds motion alone: it goes with --blur motion")
        if not self.defocus_shape or not self.defocus_ratio:
            raise _unfit(
                "--blur both needs --defocus-shape and --defocus-ratio: the shape of defocus in addition to motion, "
                "and the pixels of its half-width per unit of w"
            )
        _check_counts(each, images)


def _check_counts(each: Mapping[str, Sequence[Any]], images: int) -> None:
    """Raise BadParameter unless every option has no value, one, or one for each image."""
    for option, given in each.items():
        if len(given) not in (0, 1, images):
            raise _unfit(f"{option} takes one value, or one for each of {images} images; got {len(given)}")


def _unfit(reason: str) -> BadParameter:
    return BadParameter(reason, SEE)


def _parts(name: str) -> list[str]:
    """The files in a text; none if it names a model of blur."""
    from procedures.restoration.masks.blur_models import named
    from station.calibration.restoration.inputs import files_in

    return [] if named(name) is not None else files_in(name)


def _placed(name: str, folder: Path) -> str:
    from station.calibration.restoration.inputs import with_files

    parts = [] if NAME in name else _parts(name)
    return with_files(name, [str(folder / part) for part in parts]) if parts else name


def _beside(name: str, photograph: Path) -> str:
    return str(photograph.parent / name.replace(NAME, photograph.stem)) if NAME in name else name
