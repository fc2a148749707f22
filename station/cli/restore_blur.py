"""What `station restore` is told of the blur: its options, whether they go together, and the masks they give."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.common.log import log

if TYPE_CHECKING:
    from procedures.raw import RawFrame
    from procedures.restoration.masks.blur_operator import Array
    from procedures.restoration.unknown_motion.path_refinement import MotionShapes
    from station.calibration.restoration_inputs import BlurInput


@dataclass(frozen=True)
class BlurOptions:
    """The options by name, as the command line has them."""

    blur: str
    shapes: tuple[str, ...]
    samples_per_pixel: int | None
    ratios: tuple[float, ...]
    max_w: float | None
    prototype_region: str | None
    paths: tuple[str, ...]
    fix_path: bool
    imu: tuple[str, ...]
    focal_px: float | None
    max_inverse_depth: float | None
    exposure_s: tuple[float, ...]

    def check(self, images: int) -> None:
        """Refuse options that do not go together. Raises UsageError."""
        if (self.paths or self.fix_path) and (self.prototype_region is None or len(self.paths) != 2):
            raise click.UsageError("--recorded-path needs --prototype-region, and one path for each of two photographs")
        if self.imu:
            self._check_imu(images)
        elif (self.focal_px, self.max_inverse_depth, self.exposure_s) != (None, None, ()):
            raise click.UsageError("--focal-px, --max-inverse-depth and --exposure-s go with --imu")
        elif self.prototype_region is None:
            self._check_shapes(images)
        if len(self.ratios) >= images:
            raise click.UsageError(
                f"--ratio is for images after the first, here {images - 1}; got {len(self.ratios)} values"
            )

    def _check_shapes(self, images: int) -> None:
        if len(self.shapes) not in (1, images):
            raise click.UsageError(
                f"--shape takes one shape, or one for each of {images} images; got {len(self.shapes)}"
            )
        for name in self.shapes:
            if self.blur == "motion" and (name in ("pillbox", "gaussian") or name.startswith("polygon:")):
                raise click.UsageError(f"--shape {name} is a blur of --blur defocus; --blur motion takes text arrays")

    def _check_imu(self, images: int) -> None:
        if self.blur != "motion" or self.shapes or self.ratios or self.prototype_region:
            raise click.UsageError("--imu goes with --blur motion, without --shape, --ratio and --prototype-region")
        if len(self.imu) != images:
            raise click.UsageError(f"--imu takes one record for each of {images} images; got {len(self.imu)}")
        if self.focal_px is None or self.max_inverse_depth is None:
            raise click.UsageError("--imu needs --focal-px and --max-inverse-depth")
        if len(self.exposure_s) not in (0, 1, images):
            raise click.UsageError(f"--exposure-s takes one time, or one for each of {images} images")

    @property
    def told(self) -> dict[str, Any]:
        """What the record says of the options that are there for every blur."""
        names = ("blur", "prototype_region", "fix_path")
        return {
            **{name: getattr(self, name) for name in names},
            "shape": list(self.shapes),
            "recorded_path": list(self.paths),
        }

    def read(self, frames: list[RawFrame], photographs: list[Array]) -> BlurInput:
        """The masks of every photograph."""
        from procedures.restoration.joint.kernel_sizes import DEFAULT_MAX_W
        from station.calibration.restoration_inputs import from_arrays, from_imu_records, from_shapes

        count, size = len(frames), (photographs[0].shape[1], photographs[0].shape[2])
        each = (1.0, *self.ratios, *(self.ratios[-1:] * count))[:count] if self.ratios else ()
        if self.imu:
            exposures = self._repeated(self.exposure_s, count) or [one.exposure.exposure_s for one in frames]
            files = [Path(one) for one in self.imu]
            return from_imu_records(files, exposures, self.focal_px or 0.0, self.max_inverse_depth or 0.0, size)
        if self.prototype_region is not None:
            largest = self.max_w or DEFAULT_MAX_W
            found = _prototypes(photographs, self.prototype_region, largest, self.paths, self.fix_path)
            given = from_arrays([*found.shapes], each or (1.0,) * count, self.max_w, photographs)
            return replace(given, told={**given.told, "motion": _described(found)}, motion=found)
        masks = from_shapes(
            self._repeated(self.shapes, count),
            each,
            self.max_w,
            photographs,
            plane=next(iter(frames[0].planes)),
            samples_per_px=self.samples_per_pixel,
        )
        for one in masks.told.get("measured", ()):
            half, cut = one["half_width_px"], one["negative_light"]
            log("shape", f"measured half-width {half:.2f} pixels; {cut:.1%} negative light left out", **one)
        return masks

    @staticmethod
    def _repeated(given: tuple[Any, ...], count: int) -> list[Any]:
        """One for each photograph, from one for each or one for all."""
        return [*given] * (1 if len(given) == count else count)


def _prototypes(
    photographs: list[Array], region: str, max_w: float, paths: tuple[str, ...], fixed: bool
) -> MotionShapes:
    """Shapes of unknown motion from a flat part of the scene, begun from or fixed by recorded paths of the rig."""
    import numpy as np

    from procedures.restoration.unknown_motion.blind import prototype_shapes
    from procedures.restoration.unknown_motion.motion_splines import recorded
    from procedures.restoration.unknown_motion.path_refinement import MotionShapes, motion_of_scene
    from procedures.restoration.unknown_motion.recorded_paths import read_path, recorded_masks, recorded_shapes

    try:
        x, y, width, height = (int(part) for part in region.split(","))
    except ValueError as error:
        raise click.UsageError(f"--prototype-region is X,Y,W,H in pixels, got {region!r}") from error
    H, W = photographs[0].shape[1:]
    if not (0 <= x < x + width <= W and 0 <= y < y + height <= H):
        raise click.UsageError(f"--prototype-region {region} is not within photographs of {W} x {H}")
    parts = np.stack([p[:, y : y + height, x : x + width].mean(axis=0) for p in photographs])
    largest = int(np.ceil(max_w))
    # the scene is drawn along minus the rig's path
    drawn = [-read_path(Path(name)) for name in paths]
    if fixed:
        motion = MotionShapes(*recorded_shapes(parts, drawn, largest))
    else:
        found = prototype_shapes(parts, largest, first=recorded_masks(parts, drawn, largest) if drawn else None)
        log("prototypes", f"motion of half-width {found.half_width:.1f} pixels in the flat part")
        begun = [recorded(path, mask, found.half_width) for path, mask in zip(drawn, found.masks, strict=False)]
        box, rng = (x, y, width, height), np.random.default_rng(0)
        log("paths", "looking for the paths that the whole frame agrees with; this takes some minutes")
        motion = motion_of_scene(photographs, box, found, max_w, rng, np.stack(begun) if begun else None)
    sentence = motion.doubt or f"paths of half-width {motion.half_width:.2f} pixels in the flat part"
    log("motion", sentence, level="warning" if motion.doubt else "info", half_width=motion.half_width)
    return motion


def _described(found: MotionShapes) -> dict[str, Any]:
    """What the record says of motion found: half-width and paths in the flat part, pixels."""
    paths = None if found.path is None else found.path[:, ::8].round(3).tolist()
    return {"half_width_px": found.half_width, "paths_px": paths, "doubt": found.doubt}
