"""What blurred the photographs of one scene, told in one value, and the masks that come of it.

Whoever restores, by command, by plan or in a script, tells a `BlurSpec`; `blur_of` makes the masks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, Outcome, Refused, Verdict
from procedures.raw import Plane
from procedures.restoration.colour.estimate import in_colour
from procedures.restoration.flat_part import Box, Whole, check_region, parts
from procedures.restoration.joint.estimate import RestorationParameters, judge, restore
from procedures.restoration.joint.joint_descent import JointRound
from procedures.restoration.joint.kernel_sizes import (
    BEYOND,
    DEFAULT_MAX_W,
    default_max_w,
    fitting_ratios,
    reach_of_masks,
    stacks_of,
)
from procedures.restoration.joint.result import Restoration, told_in
from procedures.restoration.masks.blur_models import DepthUnit, mask_stack, reach
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.camera_motion import Poses, RigSettings, motion_blur, planar_stacks, px_per_inverse_m
from procedures.restoration.masks.checks import check_extent, check_max_w
from procedures.restoration.masks.defocus_and_motion import with_defocus
from procedures.restoration.masks.mask_fields import Masks
from procedures.restoration.masks.psf_shapes import MeasuredShape
from procedures.restoration.masks.shape_fields import ShapeField
from procedures.restoration.unknown_motion.blind import Prototypes, prototype_shapes
from procedures.restoration.unknown_motion.flat_scene import (
    FOUND_WEIGHT,
    FreeKernels,
    FreeKernelSettings,
    kernels_as_found,
)
from procedures.restoration.unknown_motion.kernel_error import picture_moved
from procedures.restoration.unknown_motion.motion_splines import recorded
from procedures.restoration.unknown_motion.path_refinement import REMEDY, MotionShapes, motion_of_scene
from procedures.restoration.unknown_motion.path_settings import PathSettings
from procedures.restoration.unknown_motion.recorded_paths import recorded_masks
from procedures.restoration.unknown_motion.turned_scene import kernels_of_turned_scene

Shape = npt.NDArray[np.float64] | ShapeField
"""Drawn on [-1, 1], the same over the frame; or varying over it, and measured."""
Size = tuple[int, int]
Finding = Prototypes | MotionShapes | FreeKernels


# --- what is told ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class KnownShapes:
    """A shape for each photograph: of the aperture, or of the motion's path.

    ratios, offsets : w of each photograph is ratio times the first's plus offset, in pixels; none are 1 and 0, but of
    measured shapes the ratio of their half-widths, and of kernels that of their sizes where it fits better.
    doubt : why shapes that another restoration found are not to be trusted, or None.
    """

    shapes: tuple[Shape, ...]
    ratios: tuple[float, ...] = ()
    offsets: tuple[float, ...] = ()
    doubt: str | None = None


@dataclass(frozen=True)
class RecordedMotion:
    """Where the camera was during each exposure.

    focal_px : focal length in pixels of the plane; None for a rig that is taken not to turn, w then told in pixels.
    max_inverse_m : greatest inverse depth, 1/m; None for the one that blurs by `BlurSpec.max_w`.
    settings : how finely it is drawn.
    """

    exposures: tuple[Poses, ...]
    focal_px: float | None = None
    max_inverse_m: float | None = None
    settings: RigSettings = field(default_factory=RigSettings)


@dataclass(frozen=True)
class UnknownMotion:
    """Motion that the photographs themselves have to tell, by a flat part of one distance.

    region : the part; None for the first of those with the most detail that a pair of masks explains; "whole" for a
    flat scene, whose motion may be of any form, in two photographs or more.
    paths : of the rig during each exposure, (n, 2) in any unit, where recorded: the search begins there.
    ratios : of w, as those of `KnownShapes`; none are 1.
    kernels, doubt : found before of a flat scene's motions, each (K, K) with one sample a pixel, and why they were not
    to be trusted, or None: they are taken as they are.
    settings : what the search goes by, of kernels of any form for a flat scene, of paths else; None for the usual.
    """

    region: Box | Whole | None = None
    paths: tuple[Array, ...] = ()
    ratios: tuple[float, ...] = ()
    kernels: tuple[Array, ...] = ()
    doubt: str | None = None
    settings: PathSettings | FreeKernelSettings | None = None


@dataclass(frozen=True)
class DefocusBeside:
    """The defocus of photographs that motion blurs too: of half-width ratio times w, as told, plus offset, pixels."""

    shapes: tuple[Shape, ...]
    ratios: tuple[float, ...]
    offsets: tuple[float, ...]


@dataclass(frozen=True)
class BlurSpec:
    """What is known of the blur of all photographs.

    max_w : half-width of the widest blur, pixels of the first photograph; None for 8, or a measured one's and one.
    """

    source: KnownShapes | RecordedMotion | UnknownMotion
    max_w: float | None = None
    defocus: DefocusBeside | None = None


# --- what comes of it --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SceneBlur:
    """Masks of each photograph as functions of one w.

    unit : what w is told in; max_w, ratios : as used, where w is a half-width; motion : where the photographs gave it;
    flat_w : of the whole frame, where that made the masks; doubt : of shapes that were found before, or None;
    finer : the same masks where pixels are n times as fine along each axis, and w counts in those.
    """

    masks: Sequence[Masks]
    finer: Callable[[int], Sequence[Masks]]
    unit: DepthUnit = field(default_factory=DepthUnit)
    max_w: float | None = None
    ratios: tuple[float, ...] = ()
    motion: MotionShapes | None = None
    flat_w: float | None = None
    doubt: str | None = None

    def restored(
        self,
        photographs: Sequence[Array],
        parameters: RestorationParameters | None = None,
        progress: Callable[[JointRound], None] | None = None,
    ) -> Outcome[Restoration]:
        """Picture and depth of photographs (C, H, W), as `restore` judges them; doubtful where the blur is."""
        kernels, shapes = None, None if self.motion is None else self.motion.shapes
        if self.flat_w is not None:
            parameters = of_flat_scene(parameters or RestorationParameters(), self.flat_w)
            kernels, shapes = shapes, None
        outcome = restore([*photographs], self.masks, parameters, progress)
        if self.motion is not None and self.motion.others is not None and outcome.value is not None:
            outcome = judged_by_both(outcome.value, self.motion.shapes, self.motion.others, parameters)
        outcome = told_in(self.unit, outcome, kernels, shapes)
        if self.doubt is not None and outcome.verdict is Verdict.PASS:
            outcome = replace(outcome, verdict=Verdict.DOUBTFUL, reason=self.doubt, remedy=REMEDY)
        return outcome if self.motion is None else self.motion.judged(outcome)

    def coloured(
        self, outcome: Outcome[Restoration], photographs: Sequence[Mapping[str, Plane]]
    ) -> Outcome[Restoration]:
        """The same in colour at every pixel of the sensor, of the whole mosaics that were restored."""
        if outcome.value is None:
            return outcome
        return replace(outcome, value=in_colour(outcome.value, photographs, self.finer(2)))


def blur_of(spec: BlurSpec, photographs: Sequence[Array], tell: Callable[[Finding], None] | None = None) -> SceneBlur:
    """The blur of photographs (C, H, W) of one scene.

    tell : is given what is found of unknown motion, in the flat part and then in the whole frame.

    Raises
    ------
    BadParameter, BadInput, Refused
        If it leaves nothing of the photographs, tells no depth, or motion can be found in no part of them.
    """
    if spec.max_w is not None:
        check_max_w(spec.max_w)
    source, shape = spec.source, (int(photographs[0].shape[1]), int(photographs[0].shape[2]))
    if isinstance(source, KnownShapes):
        blur = _shaped(source, spec.max_w, photographs, shape)
    elif isinstance(source, RecordedMotion):
        blur = _moved(source, spec.max_w or DEFAULT_MAX_W, shape)
    else:
        told = tell or (lambda finding: None)
        if source.region == "whole":
            blur = _of_flat_scene(source, spec.max_w, photographs, shape, told)
        else:
            blur = _found(source, spec.max_w or DEFAULT_MAX_W, photographs, shape, told)
    return blur if spec.defocus is None else _spread(blur, spec.defocus, shape)


# --- shapes ------------------------------------------------------------------------------------------------------


def _shaped(source: KnownShapes, max_w: float | None, photographs: Sequence[Array], shape: Size) -> SceneBlur:
    shapes = source.shapes
    measured = [one.half_width_px + 1 for one in shapes if isinstance(one, MeasuredShape)]
    widest = max_w or max([default_max_w(_drawn(shapes)), *measured])
    check_max_w(widest)
    ratios = source.ratios or _ratios(source, widest, photographs)
    finer = partial(_masks_of_shapes, shapes, ratios, source.offsets or (0.0,) * len(shapes), widest, shape)
    return SceneBlur(finer(1), finer, max_w=widest, ratios=ratios, doubt=source.doubt)


def _drawn(shapes: Sequence[Shape]) -> list[npt.NDArray[np.float64]]:
    return [one for one in shapes if not isinstance(one, ShapeField)]


def _ratios(source: KnownShapes, max_w: float, photographs: Sequence[Array]) -> tuple[float, ...]:
    drawn = _drawn(source.shapes)
    if len(drawn) == len(source.shapes) and not any(source.offsets):
        return fitting_ratios(photographs, drawn, max_w)
    return tuple(_ratio(source.shapes[0], one) for one in source.shapes)


def _ratio(first: Shape, other: Shape) -> float:
    if isinstance(first, MeasuredShape) and isinstance(other, MeasuredShape):
        return other.half_width_px / first.half_width_px
    return 1.0


def _masks_of_shapes(
    shapes: Sequence[Shape], ratios: Sequence[float], offsets: Sequence[float], max_w: float, shape: Size, n: int
) -> Sequence[Masks]:
    """Masks where pixels are n times as fine."""
    shifts, frame = [n * one for one in offsets], (n * shape[0], n * shape[1])
    drawn = _drawn(shapes)
    if len(drawn) == len(shapes):
        return stacks_of(drawn, ratios, n * max_w + (n - 1) * BEYOND, frame, shifts)
    R = max(reach(n * max_w, ratio, offset) for ratio, offset in zip(ratios, shifts, strict=True))
    check_extent(R, frame)
    return [
        one.masks(n * max_w, R, ratio, offset)
        if isinstance(one, ShapeField)
        else mask_stack(one, n * max_w, ratio=ratio, offset=offset, R=R)
        for one, ratio, offset in zip(shapes, ratios, shifts, strict=True)
    ]


def _spread(motion: SceneBlur, defocus: DefocusBeside, shape: Size) -> SceneBlur:
    """The blur of motion and defocus together."""
    fields = [one if isinstance(one, ShapeField) else ShapeField(((one,),)) for one in defocus.shapes]
    slopes = [one * motion.unit.per_pixel for one in defocus.ratios]

    def spread(masks: Sequence[Masks], n: int) -> Sequence[Masks]:
        both = with_defocus(masks, fields, slopes, [n * one for one in defocus.offsets])
        check_extent(both[0].R, (n * shape[0], n * shape[1]))
        return both

    return replace(motion, masks=spread(motion.masks, 1), finer=lambda n: spread(motion.finer(n), n))


# --- motion ------------------------------------------------------------------------------------------------------


def _moved(source: RecordedMotion, max_w: float, shape: Size) -> SceneBlur:
    """Of recorded motion: w is the inverse depth where the focal length is known, half-width of the path where not."""
    exposures, focal = source.exposures, source.focal_px
    if focal is None:

        def planar(n: int) -> Sequence[Masks]:
            stacks = planar_stacks([one.planar_path for one in exposures], n * max_w, source.settings)
            check_extent(stacks[0].R, (n * shape[0], n * shape[1]))
            return stacks

        return SceneBlur(planar(1), planar)
    inverse = source.max_inverse_m
    if inverse is None:
        inverse = max_w / px_per_inverse_m(exposures, focal, shape, source.settings.least_path_m)
    blur = motion_blur(exposures, focal, shape, inverse, source.settings)

    def finer(n: int) -> Sequence[Masks]:
        frame = (n * shape[0], n * shape[1])
        return motion_blur(exposures, n * focal, frame, inverse, source.settings).fields

    return SceneBlur(blur.fields, finer, blur.unit)


def _found(
    source: UnknownMotion, max_w: float, photographs: Sequence[Array], shape: Size, tell: Callable[[Finding], None]
) -> SceneBlur:
    """Of motion that the photographs tell."""
    check_extent(reach_of_masks(max_w), shape)
    motion = _motion_in(source, max_w, photographs, tell)
    ratios = source.ratios or (1.0,) * len(motion.shapes)
    return replace(_shaped(KnownShapes((*motion.shapes,), ratios), max_w, photographs, shape), motion=motion)


def _of_flat_scene(
    source: UnknownMotion,
    max_w: float | None,
    photographs: Sequence[Array],
    shape: Size,
    tell: Callable[[Finding], None],
) -> SceneBlur:
    """Of motion of any form, alike over the frame."""
    if source.kernels:
        motion = kernels_as_found(source.kernels, len(photographs), source.doubt)
    else:
        settings = source.settings if isinstance(source.settings, FreeKernelSettings) else None
        grey = np.stack([one.mean(axis=0) for one in photographs])
        found = kernels_of_turned_scene(grey, None if max_w is None else int(np.ceil(max_w)), settings)
        tell(found)
        motion = found.shapes
    known = KnownShapes((*motion.shapes,), (1.0,) * len(photographs))
    blur = _shaped(known, motion.half_width + 1, photographs, shape)
    return replace(blur, motion=motion, flat_w=motion.half_width)


def judged_by_both(
    found: Restoration, kernels: Array, others: Array, parameters: RestorationParameters | None = None
) -> Outcome[Restoration]:
    """A flat scene's picture, judged with how far it moves where the kernels of another search are taken."""
    more = picture_moved(found.sharp, kernels, others, found.history[-1].weights.picture)
    return judge(found.uncertain_by(more), parameters.limits if parameters else None)


def of_flat_scene(parameters: RestorationParameters, w: float) -> RestorationParameters:
    """How photographs are restored with kernels that they told themselves, alike over the frame."""
    weights = replace(parameters.weights, least_picture=max(parameters.weights.least_picture, FOUND_WEIGHT))
    return replace(parameters, flat_w=w, weights=weights)


def _motion_in(
    source: UnknownMotion, max_w: float, photographs: Sequence[Array], tell: Callable[[Finding], None]
) -> MotionShapes:
    """The motions' shapes from the part marked, or from the first that a pair of masks explains."""
    if isinstance(source.region, tuple):
        check_region(source.region, (photographs[0].shape[1], photographs[0].shape[2]))
        return _motion_of_part(source, source.region, max_w, photographs, tell)
    refusal: Refused | BadInput | None = None
    for box in parts(photographs[0].mean(axis=0), 32 * int(np.ceil(max_w))):
        try:
            return _motion_of_part(source, box, max_w, photographs, tell)
        except (Refused, BadInput) as error:
            refusal = error
    raise Refused(
        f"no part of the photographs shows one motion each: {refusal.reason if refusal else 'they are too small'}",
        "mark a flat part of one distance with much detail, or tell that the whole scene is flat: whole",
    )


def _motion_of_part(
    source: UnknownMotion, box: Box, max_w: float, photographs: Sequence[Array], tell: Callable[[Finding], None]
) -> MotionShapes:
    x, y, width, height = box
    cut = np.stack([one[:, y : y + height, x : x + width].mean(axis=0) for one in photographs])
    largest = int(np.ceil(max_w))
    # the scene is drawn along minus the rig's path
    drawn = [-one for one in source.paths]
    found = prototype_shapes(cut, largest, first=recorded_masks(cut, drawn, largest) if drawn else None)
    tell(found)
    begun = [recorded(path, mask, found.half_width) for path, mask in zip(drawn, found.masks, strict=False)]
    rng = np.random.default_rng(0)
    known = np.stack(begun) if begun else None
    settings = source.settings if isinstance(source.settings, PathSettings) else None
    motion = motion_of_scene([*photographs], box, found, max_w, rng, known, settings)
    tell(motion)
    return motion
