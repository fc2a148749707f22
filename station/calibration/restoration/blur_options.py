"""What a restoration is told of the blur: its options, whether they go together, and the blur they tell."""

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

Tell = Callable[..., object]
"""Hears of every step, as `station.common.log.log` does."""
SEE = "see `station restore --help`"


BLURS = ("defocus", "motion", "both")


def unfit(reason: str) -> BadParameter:
    """An option that cannot be meant so."""
    return BadParameter(reason, SEE)


def silent(event: str, sentence: str, **facts: object) -> None:
    """Nobody listens."""


@dataclass(frozen=True)
class BlurOptions:
    """The options by name, as `station restore` and a procedure file of a batch have them."""

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
        """Refuse options that do not go together. Raises BadParameter."""
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
                f"a flat part tells the motion of two photographs, not of {images}: give two, "
                "or --prototype-region whole where the whole scene is flat"
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
                "--blur both needs --defocus-shape and --defocus-ratio: the shape of defocus beside that of motion, "
                "and the pixels of its half-width for each unit of w"
            )
        for option, given in each.items():
            if given and len(given) not in (1, images):
                raise unfit(f"{option} takes one value, or one for each of {images} images; got {len(given)}")

    def spec(self, frames: list[RawFrame], photographs: list[Array]) -> BlurSpec:
        """What they tell of the blur, its files read."""
        from procedures.restoration.photograph_blur import BlurSpec, DefocusBeside

        count, source = len(frames), self._source(frames, photographs)
        if self.blur != "both":
            return BlurSpec(source, self.max_w)
        ratios, offsets = (_repeated(one, count) for one in (self.defocus_ratios, self.defocus_offsets or (0.0,)))
        shapes = _shapes(self.defocus_shapes, frames, photographs, None)
        return BlurSpec(source, self.max_w, DefocusBeside(shapes, (*ratios,), (*offsets,)))

    def _source(self, frames: list[RawFrame], photographs: list[Array]) -> KnownShapes | RecordedMotion | UnknownMotion:
        """Of what blurs most: motion, or defocus alone."""
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
        """Exposure times as told, or as the files tell, seconds."""
        return _repeated(self.exposure_s, len(frames)) or [one.exposure.exposure_s for one in frames]


def _later(given: tuple[float, ...], first: float, count: int) -> tuple[float, ...]:
    """One for each photograph, from those after the first, the last of which goes on; none where none are given."""
    return (first, *given, *(given[-1:] * count))[:count] if given else ()


def _repeated(given: tuple[Any, ...], count: int) -> list[Any]:
    """One for each photograph, from one for each or one for all."""
    return [*given] * (1 if len(given) == count else count)


def _shapes(
    names: tuple[str, ...], frames: list[RawFrame], photographs: list[Array], samples_per_px: int | None
) -> tuple[Shape, ...]:
    """A shape for each photograph."""
    from station.calibration.restoration.inputs import read_blur_shape

    plane, size = next(iter(frames[0].planes)), (photographs[0].shape[1], photographs[0].shape[2])
    return tuple(read_blur_shape(name, plane, size, samples_per_px) for name in _repeated(names, len(frames)))


# --- what is told of it ------------------------------------------------------------------------------------------


def tell_measured(spec: BlurSpec, tell: Tell) -> None:
    """Tell the sizes of measured shapes."""
    for one in _measured(spec):
        half, cut = one["half_width_px"], one["negative_light"]
        tell("shape", f"measured half-width {half:.2f} pixels; {cut:.1%} negative light left out", **one)


def tell_finding(found: Finding, tell: Tell) -> None:
    """Tell what is found of unknown motion."""
    from procedures.restoration.unknown_motion.blind import Prototypes
    from procedures.restoration.unknown_motion.flat_scene import FreeKernels

    if isinstance(found, FreeKernels):
        sentence = found.doubt or f"motions of any form within {found.half_width:.0f} pixels each way"
        told = {"half_width": found.half_width, "agreement": found.agreement}
        tell("motion", sentence, level="warning" if found.doubt else "info", **told)
    elif isinstance(found, Prototypes):
        tell("prototypes", f"motion of half-width {found.half_width:.1f} pixels in the flat part")
        tell("paths", "looking for the paths that the whole frame agrees with; this takes about a minute")
    else:
        sentence = found.doubt or f"paths of half-width {found.half_width:.2f} pixels in the flat part"
        tell("motion", sentence, level="warning" if found.doubt else "info", half_width=found.half_width)


def blur_record(options: BlurOptions, frames: list[RawFrame], spec: BlurSpec, blur: SceneBlur) -> dict[str, Any]:
    """What `result.json` says of the blur: the options, and what was found where they left it open."""
    names = {"shape": options.shapes, "recorded_path": options.paths}
    told: dict[str, Any] = {
        "blur": options.blur,
        "prototype_region": options.prototype_region,
        **{name: list(given) for name, given in names.items()},
    }
    if options.imu:
        told |= {"imu": list(options.imu), "exposure_s": options.exposures(frames)}
    elif options.poses:
        told |= {"poses": list(options.poses)}
    return told | _of_source(spec, blur) | _of_defocus(options, spec) | _of_motion(blur)


def _of_source(spec: BlurSpec, blur: SceneBlur) -> dict[str, Any]:
    from procedures.restoration.masks.mask_fields import MaskField
    from procedures.restoration.photograph_blur import KnownShapes, RecordedMotion

    source = spec.source
    if isinstance(source, RecordedMotion):
        masks = MaskField.of(blur.masks[0])
        given = {"focal_px": source.focal_px, "max_inverse_depth": source.max_inverse_m}
        return {**given, "nodes": list(masks.grid), "half_size": masks.R}
    told: dict[str, Any] = {"ratio": list(blur.ratios[1:]), "max_w": blur.max_w}
    if isinstance(source, KnownShapes) and any(source.offsets):
        told["offset"] = list(source.offsets[1:])
    measured = _measured(spec)
    return {**told, "measured": measured} if measured else told


def _measured(spec: BlurSpec) -> list[dict[str, Any]]:
    """What the record says of measured shapes."""
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
    """Of defocus beside motion."""
    if spec.defocus is None:
        return {}
    names = _repeated(options.defocus_shapes, len(spec.defocus.shapes))
    ratios, offsets = list(spec.defocus.ratios), list(spec.defocus.offsets)
    return {"defocus_shape": names, "defocus_ratio": ratios, "defocus_offset": offsets}


def _of_motion(blur: SceneBlur) -> dict[str, Any]:
    """Of motion found: half-width and paths in the flat part, pixels."""
    found = blur.motion
    if found is None:
        return {}
    paths = None if found.path is None else found.path[:, ::8].round(3).tolist()
    return {"motion": {"half_width_px": found.half_width, "paths_px": paths, "doubt": found.doubt}}
