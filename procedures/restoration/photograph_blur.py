"""Specification of the blur of the photographs of one scene, and the masks that follow from it.

Commands, plans and scripts describe the blur by a `BlurSpec`; `blur_of` makes the masks.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, Outcome, Refused, Verdict
from procedures.raw import Plane, PlaneLike
from procedures.restoration.colour.estimate import in_colour
from procedures.restoration.flat_part import Box, Whole, check_region, parts
from procedures.restoration.joint.estimate import RestorationParameters, judge, restore
from procedures.restoration.joint.joint_descent import JointRound
from procedures.restoration.joint.kernel_sizes import BEYOND, DEFAULT_MAX_W, default_max_w, fitting_ratios, stacks_of
from procedures.restoration.joint.result import Restoration, with_unit
from procedures.restoration.masks.blur_models import DepthUnit, mask_stack, reach
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.camera_motion import Poses, motion_blur, planar_stacks, px_per_inverse_m
from procedures.restoration.masks.checks import as_channels, check_extent, check_max_w, check_photographs
from procedures.restoration.masks.defocus_and_motion import with_defocus
from procedures.restoration.masks.mask_fields import Masks
from procedures.restoration.masks.psf_shapes import MeasuredShape
from procedures.restoration.masks.shape_fields import ShapeField
from procedures.restoration.time_shift import LEAST_S, TimeShift, fit_time_shift
from procedures.restoration.unknown_motion.blind import Prototypes, SearchRound, prototype_shapes
from procedures.restoration.unknown_motion.flat_scene import (
    MIN_PICTURE_WEIGHT,
    FreeKernels,
    KernelEffort,
    given_kernels,
)
from procedures.restoration.unknown_motion.kernel_error import picture_change
from procedures.restoration.unknown_motion.motion_splines import fit_recorded
from procedures.restoration.unknown_motion.path_refinement import REMEDY, MotionShapes, PathEffort, motion_of_scene
from procedures.restoration.unknown_motion.recorded_paths import recorded_masks
from procedures.restoration.unknown_motion.rotated_scene import kernels_of_rotated_scene

Shape = npt.NDArray[np.float64] | ShapeField
"""Array on [-1, 1], constant over the frame; or a measured field over it."""
Size = tuple[int, int]
Finding = Prototypes | MotionShapes | FreeKernels | SearchRound


@dataclass(frozen=True)
class KnownShapes:
    """A shape for each photograph: of the aperture, or of the motion's path.

    ratios, offsets : w of each photograph is ratio times the first's plus offset, in pixels; defaults 1 and 0, but for
    measured shapes the ratio of their half-widths, and for kernels that of their sizes where it fits better.
    caveat : why shapes from another restoration are unreliable, or None.
    """

    shapes: tuple[Shape, ...]
    ratios: tuple[float, ...] = ()
    offsets: tuple[float, ...] = ()
    caveat: str | None = None


@dataclass(frozen=True)
class RecordedMotion:
    """Poses of the camera during each exposure.

    focal_px : focal length in pixels of the plane; None for a rig without rotation, with w in pixels.
    max_inverse_m : largest inverse depth, 1/m; None for the one that blurs by `BlurSpec.max_w`.
    within_s : bound of the common error of the records' times; `late` : the poses if the times are late by so much, by
    which the error is fitted.
    scale_uncertainty : relative standard uncertainty of all inverse depths, from that of the motions' amplitudes.
    """

    exposures: tuple[Poses, ...]
    focal_px: float | None = None
    max_inverse_m: float | None = None
    within_s: float = 0.0
    late: Callable[[float], tuple[Poses, ...]] | None = None
    scale_uncertainty: float = 0.0


@dataclass(frozen=True)
class UnknownMotion:
    """Motion to be estimated from the photographs, by a flat part at one distance.

    region : the part; None for the first of those with most detail that a pair of masks explains; "whole" for a flat
    scene, with motion of any form, in two photographs or more.
    paths : of the rig during each exposure, (n, 2) in any unit, if recorded: starting point of the search.
    ratios : of w, as in `KnownShapes`; default 1.
    kernels, caveat : known kernels of a flat scene's motions, each (K, K) with one sample a pixel, used unchanged, and
    why they are unreliable, or None.
    effort : of the search of kernels of any form for a flat scene, of paths otherwise; None for the default.
    """

    region: Box | Whole | None = None
    paths: tuple[Array, ...] = ()
    ratios: tuple[float, ...] = ()
    kernels: tuple[Array, ...] = ()
    caveat: str | None = None
    effort: PathEffort | KernelEffort | None = None


@dataclass(frozen=True)
class AdditionalDefocus:
    """Defocus in addition to motion, of half-width ratio times w in its unit plus offset, pixels."""

    shapes: tuple[Shape, ...]
    ratios: tuple[float, ...]
    offsets: tuple[float, ...]


@dataclass(frozen=True)
class BlurSpec:
    """Specification of the blur of all photographs.

    max_w : half-width of the widest blur, pixels of the first photograph; None for 8, or a measured kernel's plus one.
    """

    source: KnownShapes | RecordedMotion | UnknownMotion
    max_w: float | None = None
    defocus: AdditionalDefocus | None = None


@dataclass(frozen=True)
class SceneBlur:
    """Masks of each photograph as functions of one w.

    unit : of w; max_w, ratios : as used, where w is a half-width; motion : if estimated from the photographs; flat_w :
    of the whole frame, if that made the masks; caveat : of known shapes, or None; finer : the same masks on pixels n
    times as fine along each axis, with w in those; time_shift : of recorded motion, where it was fitted.
    """

    masks: Sequence[Masks]
    finer: Callable[[int], Sequence[Masks]]
    unit: DepthUnit = field(default_factory=DepthUnit)
    max_w: float | None = None
    ratios: tuple[float, ...] = ()
    motion: MotionShapes | None = None
    flat_w: float | None = None
    caveat: str | None = None
    time_shift: TimeShift | None = None

    def restored(
        self,
        photographs: Sequence[PlaneLike],
        parameters: RestorationParameters | None = None,
        progress: Callable[[JointRound], None] | None = None,
    ) -> Outcome[Restoration]:
        """Picture and depth of photographs, as `restore` takes and judges them; doubtful if the blur is."""
        kernels, shapes = None, None if self.motion is None else self.motion.shapes
        if self.flat_w is not None:
            p = parameters or RestorationParameters()
            least = max(p.least_image_weight, MIN_PICTURE_WEIGHT)
            parameters = replace(p, flat_w=self.flat_w, least_image_weight=least)
            kernels, shapes = shapes, None
        outcome = restore([*photographs], self.masks, parameters, progress)
        if self.motion is not None and self.motion.others is not None and outcome.value is not None:
            outcome = judge_with_alternative(outcome.value, self.motion.shapes, self.motion.others)
        outcome = with_unit(self.unit, outcome, kernels, shapes)
        if self.caveat is not None and outcome.verdict is Verdict.PASS:
            outcome = replace(outcome, verdict=Verdict.DOUBTFUL, reason=self.caveat, remedy=REMEDY)
        return outcome if self.motion is None else self.motion.judged(outcome)

    def coloured(
        self, outcome: Outcome[Restoration], photographs: Sequence[Mapping[str, Plane]]
    ) -> Outcome[Restoration]:
        """A restoration with colour at every pixel of the sensor, from the complete mosaics of the photographs."""
        if outcome.value is None:
            return outcome
        return replace(outcome, value=in_colour(outcome.value, photographs, self.finer(2)))


def blur_of(
    spec: BlurSpec, photographs: Sequence[PlaneLike], report: Callable[[Finding], object] | None = None
) -> SceneBlur:
    """The blur of photographs of one scene: arrays (H, W) or (C, H, W), or planes.

    report : receives estimates of unknown motion, in the flat part and then in the whole frame, and the rounds of
    their search.

    Raises BadParameter, BadInput, Refused if it leaves nothing of the photographs or does not determine depth, or if
    motion cannot be estimated.
    """
    if spec.max_w is not None:
        check_max_w(spec.max_w)
    channels = list(check_photographs(as_channels(photographs)))
    source, shape = spec.source, (int(channels[0].shape[1]), int(channels[0].shape[2]))
    if isinstance(source, KnownShapes):
        blur = _shaped(source, spec.max_w, channels, shape)
    elif isinstance(source, RecordedMotion):
        blur = _in_time(source, spec.max_w or DEFAULT_MAX_W, channels)
    else:
        report = report or (lambda finding: None)
        if source.region == "whole":
            blur = _of_flat_scene(source, spec.max_w, channels, shape, report)
        else:
            blur = _estimated(source, spec.max_w or DEFAULT_MAX_W, channels, shape, report)
    return blur if spec.defocus is None else _spread(blur, spec.defocus, shape)


def _shaped(source: KnownShapes, max_w: float | None, photographs: Sequence[Array], shape: Size) -> SceneBlur:
    shapes = source.shapes
    measured = [one.half_width_px + 1 for one in shapes if isinstance(one, MeasuredShape)]
    widest = max_w or max([default_max_w(_arrays(shapes)), *measured])
    check_max_w(widest)
    ratios = source.ratios or _ratios(source, widest, photographs)
    finer = partial(_masks_of_shapes, shapes, ratios, source.offsets or (0.0,) * len(shapes), widest, shape)
    return SceneBlur(finer(1), finer, max_w=widest, ratios=ratios, caveat=source.caveat)


def _arrays(shapes: Sequence[Shape]) -> list[npt.NDArray[np.float64]]:
    return [shape for shape in shapes if not isinstance(shape, ShapeField)]


def _ratios(source: KnownShapes, max_w: float, photographs: Sequence[Array]) -> tuple[float, ...]:
    arrays = _arrays(source.shapes)
    if len(arrays) == len(source.shapes) and not any(source.offsets):
        return fitting_ratios(photographs, arrays, max_w)
    if isinstance(first := source.shapes[0], MeasuredShape):
        each = source.shapes
        return tuple(one.half_width_px / first.half_width_px if isinstance(one, MeasuredShape) else 1.0 for one in each)
    return (1.0,) * len(source.shapes)


def _masks_of_shapes(
    shapes: Sequence[Shape], ratios: Sequence[float], offsets: Sequence[float], max_w: float, shape: Size, n: int
) -> Sequence[Masks]:
    shifts, frame = [n * one for one in offsets], (n * shape[0], n * shape[1])
    arrays = _arrays(shapes)
    if len(arrays) == len(shapes):
        return stacks_of(arrays, ratios, n * max_w + (n - 1) * BEYOND, frame, shifts)
    R = max(reach(n * max_w, ratio, offset) for ratio, offset in zip(ratios, shifts, strict=True))
    check_extent(R, frame)
    return [
        one.masks(n * max_w, R, ratio, offset)
        if isinstance(one, ShapeField)
        else mask_stack(one, n * max_w, ratio=ratio, offset=offset, R=R)
        for one, ratio, offset in zip(shapes, ratios, shifts, strict=True)
    ]


def _spread(motion: SceneBlur, defocus: AdditionalDefocus, shape: Size) -> SceneBlur:
    fields = [one if isinstance(one, ShapeField) else ShapeField(((one,),)) for one in defocus.shapes]
    slopes = [ratio * motion.unit.per_pixel for ratio in defocus.ratios]

    def spread(masks: Sequence[Masks], n: int) -> Sequence[Masks]:
        convolved = with_defocus(masks, fields, slopes, [n * offset for offset in defocus.offsets])
        check_extent(convolved[0].R, (n * shape[0], n * shape[1]))
        return convolved

    return replace(motion, masks=spread(motion.masks, 1), finer=lambda n: spread(motion.finer(n), n))


def _in_time(source: RecordedMotion, max_w: float, photographs: Sequence[Array]) -> SceneBlur:
    """Blur of recorded motion, its times corrected by a fit where they are uncertain."""
    shape = (int(photographs[0].shape[1]), int(photographs[0].shape[2]))
    if source.late is None or source.within_s < LEAST_S:
        return _recorded(source, max_w, shape)
    late = source.late

    def masks_at(late_s: float, part: Size) -> Sequence[Masks]:
        return _recorded(replace(source, exposures=late(late_s)), max_w, part).masks

    shift = fit_time_shift(photographs, masks_at, source.within_s)
    return replace(_recorded(replace(source, exposures=late(shift.late_s)), max_w, shape), time_shift=shift)


def _recorded(source: RecordedMotion, max_w: float, shape: Size) -> SceneBlur:
    """Blur of recorded motion: w is the inverse depth if the focal length is known, else the path's half-width."""
    exposures, focal = source.exposures, source.focal_px
    if focal is None:

        def planar(n: int) -> Sequence[Masks]:
            stacks = planar_stacks([exposure.planar_path for exposure in exposures], n * max_w)
            check_extent(stacks[0].R, (n * shape[0], n * shape[1]))
            return stacks

        return SceneBlur(planar(1), planar)
    inverse = source.max_inverse_m
    if inverse is None:
        inverse = max_w / px_per_inverse_m(exposures, focal, shape)
    blur = motion_blur(exposures, focal, shape, inverse)

    def finer(n: int) -> Sequence[Masks]:
        frame = (n * shape[0], n * shape[1])
        return motion_blur(exposures, n * focal, frame, inverse).fields

    return SceneBlur(blur.fields, finer, blur.unit)


def _estimated(
    source: UnknownMotion, max_w: float, photographs: Sequence[Array], shape: Size, report: Callable[[Finding], object]
) -> SceneBlur:
    check_extent(reach(max_w + BEYOND), shape)
    motion = _motion_in(source, max_w, photographs, report)
    ratios = source.ratios or (1.0,) * len(motion.shapes)
    return replace(_shaped(KnownShapes((*motion.shapes,), ratios), max_w, photographs, shape), motion=motion)


def _of_flat_scene(
    source: UnknownMotion, max_w: float | None, photographs: Sequence[Array], shape: Size,
    report: Callable[[Finding], object],
) -> SceneBlur:  # fmt: skip
    if source.kernels:
        motion = given_kernels(source.kernels, len(photographs), source.caveat)
    else:
        effort = source.effort if isinstance(source.effort, KernelEffort) else None
        grey = np.stack([photograph.mean(axis=0) for photograph in photographs])
        kernels = kernels_of_rotated_scene(grey, None if max_w is None else int(np.ceil(max_w)), effort, report)
        report(kernels)
        motion = kernels.shapes
    known = KnownShapes((*motion.shapes,), (1.0,) * len(photographs))
    blur = _shaped(known, motion.half_width + 1, photographs, shape)
    return replace(blur, motion=motion, flat_w=motion.half_width)


def judge_with_alternative(restoration: Restoration, kernels: Array, others: Array) -> Outcome[Restoration]:
    """A flat scene's picture, judged with its change under the kernels of another search."""
    more = picture_change(restoration.sharp, kernels, others, restoration.history[-1].weights.picture)
    return judge(restoration.with_added_error("kernels", more))


def _motion_in(
    source: UnknownMotion, max_w: float, photographs: Sequence[Array], report: Callable[[Finding], object]
) -> MotionShapes:
    if isinstance(source.region, tuple):
        check_region(source.region, (photographs[0].shape[1], photographs[0].shape[2]))
        return _motion_of_part(source, source.region, max_w, photographs, report)
    refusal: Refused | BadInput | None = None
    for box in parts(photographs[0].mean(axis=0), 32 * int(np.ceil(max_w))):
        try:
            return _motion_of_part(source, box, max_w, photographs, report)
        except (Refused, BadInput) as error:
            refusal = error
    raise Refused(
        f"no part of the photographs has one motion each: {refusal.reason if refusal else 'they are too small'}",
        "mark a flat part at one distance with much detail, or give whole if the whole scene is flat",
    )


def _motion_of_part(
    source: UnknownMotion, box: Box, max_w: float, photographs: Sequence[Array], report: Callable[[Finding], object]
) -> MotionShapes:
    x, y, width, height = box
    cut = np.stack([photograph[:, y : y + height, x : x + width].mean(axis=0) for photograph in photographs])
    largest = int(np.ceil(max_w))
    # the image moves opposite to the rig
    paths = [-path for path in source.paths]
    prototypes = prototype_shapes(cut, largest, first=recorded_masks(cut, paths, largest) if paths else None)
    report(prototypes)
    starts = [
        fit_recorded(path, mask, prototypes.half_width) for path, mask in zip(paths, prototypes.masks, strict=False)
    ]
    rng = np.random.default_rng(0)
    known = np.stack(starts) if starts else None
    effort = source.effort if isinstance(source.effort, PathEffort) else None
    motion = motion_of_scene([*photographs], box, prototypes, max_w, rng, known, effort, report)
    report(motion)
    return motion
