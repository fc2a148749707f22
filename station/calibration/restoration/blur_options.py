"""Options that describe the blur of a restoration, their consistency, and the resulting blur."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from procedures.numbers import ENERGY_OUTSIDE_SUPPORT
from procedures.outcome import BadParameter
from procedures.restoration.masks.checks import check_max_w

if TYPE_CHECKING:
    from procedures.raw import RawFrame
    from procedures.restoration.masks.blur_operator import Array
    from procedures.restoration.photograph_blur import (
        BlurSpec,
        Finding,
        KnownShapes,
        RecordedMotion,
        SceneBlur,
        Shape,
        UnknownMotion,
    )

Report = Callable[..., object]
"""Callback for every step, as `station.common.log.log`."""
SEE = "see `station restore --help`"


BLURS = ("defocus", "motion", "both")


def unfit(reason: str) -> BadParameter:
    """The exception for an inconsistent option."""
    return BadParameter(reason, SEE)


def no_report(event: str, sentence: str, **facts: object) -> None:
    """No-op callback."""


@dataclass(frozen=True)
class BlurOptions:
    """The options by name, as in `station restore` and in a procedure file of a batch."""

    blur: str
    shapes: tuple[str, ...] = ()
    samples_per_pixel: int | None = None
    ratios: tuple[float, ...] = ()
    offsets: tuple[float, ...] = ()
    defocus_shapes: tuple[str, ...] = ()
    defocus_ratios: tuple[float, ...] = ()
    defocus_offsets: tuple[float, ...] = ()
    max_w: float | None = None
    prototype_region: str | None = None
    paths: tuple[str, ...] = ()
    imu: tuple[str, ...] = ()
    poses: tuple[str, ...] = ()
    focal_px: float | None = None
    max_inverse_depth: float | None = None
    exposure_s: tuple[float, ...] = ()

    def check(self, images: int) -> None:
        """Refuse inconsistent options. Raises BadParameter."""
        if self.blur not in BLURS:
            raise unfit(f"--blur is one of {', '.join(BLURS)}, not {self.blur!r}")
        if self.max_w is not None:
            check_max_w(self.max_w)
        if self.paths and (self.prototype_region is None or len(self.paths) != 2):
            raise unfit("--recorded-path needs --prototype-region, and one path for each of two photographs")
        if self.imu or self.poses:
            self._check_recorded(images)
        elif (self.focal_px, self.max_inverse_depth) != (None, None):
            raise unfit("--focal-px and --max-inverse-depth go with --imu and --poses")
        elif self.prototype_region is None:
            self._check_shapes(images)
        if self.prototype_region is not None:
            self._check_region(images)
        if self.exposure_s and not self.imu:
            raise unfit("--exposure-s goes with --imu")
        for option, given in (("--ratio", self.ratios), ("--offset", self.offsets)):
            if len(given) >= images:
                raise unfit(f"{option} is for images after the first, here {images - 1}; got {len(given)} values")
        if self.offsets and (self.blur != "defocus" or self.prototype_region):
            raise unfit("--offset goes with --blur defocus: it comes from another focus")
        self._check_defocus(images)

    def _check_region(self, images: int) -> None:
        whole = (self.prototype_region or "").strip().lower() == "whole"
        if self.shapes and not whole:
            raise unfit("--shape goes with --prototype-region whole, as kernels found before, or without a region")
        if self.shapes and len(self.shapes) != images:
            raise unfit(f"--shape takes one kernel for each of {images} images of a flat scene; got {len(self.shapes)}")
        if whole and (self.paths or self.ratios):
            raise unfit("--prototype-region whole finds every motion by itself, without --recorded-path and --ratio")
        if not whole and images > 2:
            raise unfit(
                f"a flat part determines the motion of two photographs, not of {images}: give two, "
                "or --prototype-region whole if the whole scene is flat"
            )

    def _check_shapes(self, images: int) -> None:
        if len(self.shapes) not in (1, images):
            raise unfit(f"--shape takes one shape, or one for each of {images} images; got {len(self.shapes)}")
        for name in self.shapes:
            if self.blur != "defocus" and (name in ("pillbox", "gaussian") or name.startswith("polygon:")):
                raise unfit(
                    f"--shape {name} is a blur of --blur defocus; --blur {self.blur} takes text arrays of motion"
                )

    def _check_recorded(self, images: int) -> None:
        option, records = ("--imu", self.imu) if self.imu else ("--poses", self.poses)
        if self.imu and self.poses:
            raise unfit("give --imu or --poses, not both")
        if self.blur == "defocus" or self.shapes or self.ratios or self.prototype_region:
            raise unfit(f"{option} goes with --blur motion or both, without --shape, --ratio and --prototype-region")
        if len(records) != images:
            raise unfit(f"{option} takes one record for each of {images} images; got {len(records)}")
        if self.focal_px is None or self.max_inverse_depth is None:
            raise unfit(f"{option} needs --focal-px and --max-inverse-depth")
        if len(self.exposure_s) not in (0, 1, images):
            raise unfit(f"--exposure-s takes one time, or one for each of {images} images")

    def _check_defocus(self, images: int) -> None:
        each = {
            "--defocus-shape": self.defocus_shapes,
            "--defocus-ratio": self.defocus_ratios,
            "--defocus-offset": self.defocus_offsets,
        }
        if self.blur != "both":
            if any(each.values()):
                raise unfit(f"{', '.join(each)} go with --blur both")
            return
        if self.prototype_region:
            raise unfit("--prototype-region finds motion alone: it goes with --blur motion")
        if not self.defocus_shapes or not self.defocus_ratios:
            raise unfit(
                "--blur both needs --defocus-shape and --defocus-ratio: the shape of defocus in addition to motion, "
                "and the pixels of its half-width per unit of w"
            )
        for option, given in each.items():
            if given and len(given) not in (1, images):
                raise unfit(f"{option} takes one value, or one for each of {images} images; got {len(given)}")

    def spec(self, frames: list[RawFrame], photographs: list[Array]) -> BlurSpec:
        """The specification of the blur, with its files read."""
        from procedures.restoration.photograph_blur import AdditionalDefocus, BlurSpec

        count, source = len(frames), self._source(frames, photographs)
        if self.blur != "both":
            return BlurSpec(source, self.max_w)
        ratios, offsets = (_repeated(one, count) for one in (self.defocus_ratios, self.defocus_offsets or (0.0,)))
        shapes = _shapes(self.defocus_shapes, frames, photographs, None)
        return BlurSpec(source, self.max_w, AdditionalDefocus(shapes, (*ratios,), (*offsets,)))

    def _source(self, frames: list[RawFrame], photographs: list[Array]) -> KnownShapes | RecordedMotion | UnknownMotion:
        from procedures.restoration.flat_part import region_of
        from procedures.restoration.photograph_blur import KnownShapes, UnknownMotion
        from procedures.restoration.unknown_motion.recorded_paths import read_path
        from station.calibration.restoration.inputs import doubt_of, read_kernels

        if self.imu or self.poses:
            return self._recorded(frames)
        ratios = _later(self.ratios, 1.0, len(frames))
        if self.prototype_region is not None:
            paths = tuple(read_path(Path(one)) for one in self.paths)
            kernels, doubt = read_kernels([Path(one) for one in self.shapes])
            return UnknownMotion(region_of(self.prototype_region), paths, ratios, kernels, doubt)
        shapes = _shapes(self.shapes, frames, photographs, self.samples_per_pixel)
        return KnownShapes(shapes, ratios, _later(self.offsets, 0.0, len(frames)), doubt_of(self.shapes))

    def _recorded(self, frames: list[RawFrame]) -> RecordedMotion:
        from procedures.restoration.photograph_blur import RecordedMotion
        from station.calibration.restoration.inputs import poses_of_records, read_poses

        if self.poses:
            poses = tuple(read_poses(Path(one)) for one in self.poses)
        else:
            poses = poses_of_records([Path(one) for one in self.imu], self.exposures(frames))
        return RecordedMotion(poses, self.focal_px, self.max_inverse_depth)

    def exposures(self, frames: list[RawFrame]) -> list[float | None]:
        """Exposure times in seconds, as given, or as recorded in the files."""
        return _repeated(self.exposure_s, len(frames)) or [one.exposure.exposure_s for one in frames]


def _later(given: tuple[float, ...], first: float, count: int) -> tuple[float, ...]:
    """One value per photograph, from those after the first, the last of which is repeated; none if none is given."""
    return (first, *given, *(given[-1:] * count))[:count] if given else ()


def _repeated(given: tuple[Any, ...], count: int) -> list[Any]:
    """One value per photograph, from one for each or one for all."""
    return [*given] * (1 if len(given) == count else count)


def _shapes(
    names: tuple[str, ...], frames: list[RawFrame], photographs: list[Array], samples_per_px: int | None
) -> tuple[Shape, ...]:
    from station.calibration.restoration.inputs import read_blur_shape

    plane, size = next(iter(frames[0].planes)), (photographs[0].shape[1], photographs[0].shape[2])
    return tuple(read_blur_shape(name, plane, size, samples_per_px) for name in _repeated(names, len(frames)))


def report_measured(spec: BlurSpec, report: Report) -> None:
    """Report the sizes of measured shapes."""
    for shape in _measured(spec):
        half, cut = shape["half_width_px"], shape["negative_light"]
        report("shape", f"measured half-width {half:.2f} pixels; {cut:.1%} negative light excluded", **shape)


def report_finding(motion: Finding, report: Report) -> None:
    """Report estimates of unknown motion."""
    from procedures.restoration.unknown_motion.blind import Prototypes
    from procedures.restoration.unknown_motion.flat_scene import FreeKernels

    if isinstance(motion, FreeKernels):
        sentence = motion.doubt or f"motions of any form within {motion.half_width:.0f} pixels each way"
        facts = {"half_width": motion.half_width, "agreement": motion.agreement}
        report("motion", sentence, level="warning" if motion.doubt else "info", **facts)
    elif isinstance(motion, Prototypes):
        report("prototypes", f"motion of half-width {motion.half_width:.1f} pixels in the flat part")
        report("paths", "searching for the paths that agree with the whole frame; this takes about a minute")
    else:
        sentence = motion.doubt or f"paths of half-width {motion.half_width:.2f} pixels in the flat part"
        report("motion", sentence, level="warning" if motion.doubt else "info", half_width=motion.half_width)


def blur_record(options: BlurOptions, frames: list[RawFrame], spec: BlurSpec, blur: SceneBlur) -> dict[str, Any]:
    """Entries of `result.json` on the blur: the options, and estimates."""
    names = {"shape": options.shapes, "recorded_path": options.paths}
    entries: dict[str, Any] = {
        "blur": options.blur,
        "prototype_region": options.prototype_region,
        **{name: list(given) for name, given in names.items()},
    }
    if options.imu:
        entries |= {"imu": list(options.imu), "exposure_s": options.exposures(frames)}
    elif options.poses:
        entries |= {"poses": list(options.poses)}
    return entries | _of_source(spec, blur) | _of_defocus(options, spec) | _of_motion(blur)


def _of_source(spec: BlurSpec, blur: SceneBlur) -> dict[str, Any]:
    from procedures.restoration.masks.mask_fields import MaskField
    from procedures.restoration.photograph_blur import KnownShapes, RecordedMotion

    source = spec.source
    if isinstance(source, RecordedMotion):
        masks = MaskField.of(blur.masks[0])
        given = {"focal_px": source.focal_px, "max_inverse_depth": source.max_inverse_m}
        return {**given, "nodes": list(masks.grid), "half_size": masks.R}
    entries: dict[str, Any] = {"ratio": list(blur.ratios[1:]), "max_w": blur.max_w}
    if isinstance(source, KnownShapes) and any(source.offsets):
        entries["offset"] = list(source.offsets[1:])
    measured = _measured(spec)
    return {**entries, "measured": measured} if measured else entries


def _measured(spec: BlurSpec) -> list[dict[str, Any]]:
    from procedures.restoration.masks.psf_shapes import MeasuredShape
    from procedures.restoration.photograph_blur import KnownShapes

    shapes = spec.source.shapes if isinstance(spec.source, KnownShapes) else ()
    return [
        {
            "half_width_px": one.half_width_px,
            "negative_light": one.cut,
            ENERGY_OUTSIDE_SUPPORT: one.energy_outside_support,
        }
        for one in shapes
        if isinstance(one, MeasuredShape)
    ]


def _of_defocus(options: BlurOptions, spec: BlurSpec) -> dict[str, Any]:
    if spec.defocus is None:
        return {}
    names = _repeated(options.defocus_shapes, len(spec.defocus.shapes))
    ratios, offsets = list(spec.defocus.ratios), list(spec.defocus.offsets)
    return {"defocus_shape": names, "defocus_ratio": ratios, "defocus_offset": offsets}


def _of_motion(blur: SceneBlur) -> dict[str, Any]:
    motion = blur.motion
    if motion is None:
        return {}
    paths = None if motion.path is None else motion.path[:, ::8].round(3).tolist()
    return {"motion": {"half_width_px": motion.half_width, "paths_px": paths, "doubt": motion.doubt}}
