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
    offsets: tuple[float, ...]
    defocus_shapes: tuple[str, ...]
    defocus_ratios: tuple[float, ...]
    defocus_offsets: tuple[float, ...]
    max_w: float | None
    prototype_region: str | None
    paths: tuple[str, ...]
    imu: tuple[str, ...]
    poses: tuple[str, ...]
    focal_px: float | None
    max_inverse_depth: float | None
    exposure_s: tuple[float, ...]

    def check(self, images: int) -> None:
        """Refuse options that do not go together. Raises UsageError."""
        if self.paths and (self.prototype_region is None or len(self.paths) != 2):
            raise click.UsageError("--recorded-path needs --prototype-region, and one path for each of two photographs")
        if self.imu or self.poses:
            self._check_recorded(images)
        elif (self.focal_px, self.max_inverse_depth) != (None, None):
            raise click.UsageError("--focal-px and --max-inverse-depth go with --imu and --poses")
        elif self.prototype_region is None:
            self._check_shapes(images)
        if self.exposure_s and not self.imu:
            raise click.UsageError("--exposure-s goes with --imu")
        for option, given in (("--ratio", self.ratios), ("--offset", self.offsets)):
            if len(given) >= images:
                raise click.UsageError(
                    f"{option} is for images after the first, here {images - 1}; got {len(given)} values"
                )
        if self.offsets and (self.blur != "defocus" or self.prototype_region):
            raise click.UsageError("--offset goes with --blur defocus: it comes from another focus")
        self._check_defocus(images)

    def _check_shapes(self, images: int) -> None:
        if len(self.shapes) not in (1, images):
            raise click.UsageError(
                f"--shape takes one shape, or one for each of {images} images; got {len(self.shapes)}"
            )
        for name in self.shapes:
            if self.blur != "defocus" and (name in ("pillbox", "gaussian") or name.startswith("polygon:")):
                raise click.UsageError(
                    f"--shape {name} is a blur of --blur defocus; --blur {self.blur} takes text arrays of motion"
                )

    def _check_recorded(self, images: int) -> None:
        option, records = ("--imu", self.imu) if self.imu else ("--poses", self.poses)
        if self.imu and self.poses:
            raise click.UsageError("give --imu or --poses, not both")
        if self.blur == "defocus" or self.shapes or self.ratios or self.prototype_region:
            raise click.UsageError(
                f"{option} goes with --blur motion or both, without --shape, --ratio and --prototype-region"
            )
        if len(records) != images:
            raise click.UsageError(f"{option} takes one record for each of {images} images; got {len(records)}")
        if self.focal_px is None or self.max_inverse_depth is None:
            raise click.UsageError(f"{option} needs --focal-px and --max-inverse-depth")
        if len(self.exposure_s) not in (0, 1, images):
            raise click.UsageError(f"--exposure-s takes one time, or one for each of {images} images")

    def _check_defocus(self, images: int) -> None:
        each = {
            "--defocus-shape": self.defocus_shapes,
            "--defocus-ratio": self.defocus_ratios,
            "--defocus-offset": self.defocus_offsets,
        }
        if self.blur != "both":
            if any(each.values()):
                raise click.UsageError(f"{', '.join(each)} go with --blur both")
            return
        if self.prototype_region:
            raise click.UsageError("--prototype-region finds motion alone: it goes with --blur motion")
        if not self.defocus_shapes or not self.defocus_ratios:
            raise click.UsageError(
                "--blur both needs --defocus-shape and --defocus-ratio: the shape of defocus beside that of motion, "
                "and the pixels of its half-width for each unit of w"
            )
        for option, given in each.items():
            if given and len(given) not in (1, images):
                raise click.UsageError(
                    f"{option} takes one value, or one for each of {images} images; got {len(given)}"
                )

    @property
    def told(self) -> dict[str, Any]:
        """What the record says of the options that are there for every blur."""
        names = ("blur", "prototype_region")
        return {
            **{name: getattr(self, name) for name in names},
            "shape": list(self.shapes),
            "recorded_path": list(self.paths),
        }

    def read(self, frames: list[RawFrame], photographs: list[Array]) -> BlurInput:
        """The masks of every photograph."""
        from station.calibration.restoration_inputs import spread_by_defocus

        plane = next(iter(frames[0].planes))
        found = self._read(frames, photographs, plane)
        for one in found.told.get("measured", ()):
            half, cut = one["half_width_px"], one["negative_light"]
            log("shape", f"measured half-width {half:.2f} pixels; {cut:.1%} negative light left out", **one)
        if self.blur != "both":
            return found
        names, ratios, offsets = (
            self._repeated(one, len(frames))
            for one in (self.defocus_shapes, self.defocus_ratios, self.defocus_offsets or (0.0,))
        )
        return spread_by_defocus(found, names, ratios, offsets, photographs, plane)

    def _read(self, frames: list[RawFrame], photographs: list[Array], plane: str) -> BlurInput:
        """The masks of what blurs most: motion, or defocus alone."""
        from procedures.restoration.joint.kernel_sizes import DEFAULT_MAX_W
        from station.calibration.restoration_inputs import from_arrays, from_imu_records, from_poses, from_shapes

        count, size = len(frames), (photographs[0].shape[1], photographs[0].shape[2])
        each, by = self._later(self.ratios, 1.0, count), self._later(self.offsets, 0.0, count)
        focal, inverse = self.focal_px or 0.0, self.max_inverse_depth or 0.0
        if self.poses:
            return from_poses([Path(one) for one in self.poses], focal, inverse, size)
        if self.imu:
            exposures = self._repeated(self.exposure_s, count) or [one.exposure.exposure_s for one in frames]
            return from_imu_records([Path(one) for one in self.imu], exposures, focal, inverse, size)
        if self.prototype_region is not None:
            largest = self.max_w or DEFAULT_MAX_W
            found = _prototypes(photographs, self.prototype_region, largest, self.paths)
            given = from_arrays([*found.shapes], each or (1.0,) * count, self.max_w, photographs)
            return replace(given, told={**given.told, "motion": _described(found)}, motion=found)
        names, samples = self._repeated(self.shapes, count), self.samples_per_pixel
        return from_shapes(names, each, self.max_w, photographs, plane=plane, samples_per_px=samples, offsets=by)

    @staticmethod
    def _later(given: tuple[float, ...], first: float, count: int) -> tuple[float, ...]:
        """One for each photograph, from those after the first, the last of which goes on; none where none are given."""
        return (first, *given, *(given[-1:] * count))[:count] if given else ()

    @staticmethod
    def _repeated(given: tuple[Any, ...], count: int) -> list[Any]:
        """One for each photograph, from one for each or one for all."""
        return [*given] * (1 if len(given) == count else count)


def _prototypes(photographs: list[Array], region: str, max_w: float, paths: tuple[str, ...]) -> MotionShapes:
    """Shapes of unknown motion from a flat part of the scene, begun from recorded paths of the rig."""
    import numpy as np

    from procedures.restoration.unknown_motion.blind import prototype_shapes
    from procedures.restoration.unknown_motion.motion_splines import recorded
    from procedures.restoration.unknown_motion.path_refinement import motion_of_scene
    from procedures.restoration.unknown_motion.recorded_paths import read_path, recorded_masks

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
