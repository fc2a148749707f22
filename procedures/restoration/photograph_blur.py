"""The blur of a plan's two photographs, from what is known of lens, focus and motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from procedures.facts import required
from procedures.outcome import BadInput, BadParameter, Refused
from procedures.raw import Plane, RawFrame
from procedures.restoration.facts import MOTIONS, RestorationFacts
from procedures.restoration.joint.kernel_sizes import reach_of_masks, stacks_of
from procedures.restoration.masks import thin_lens
from procedures.restoration.masks.blur_models import Unit, named
from procedures.restoration.masks.camera_motion import Poses, motion_blur, planar_stacks, px_per_inverse_m
from procedures.restoration.masks.checks import check_extent, check_max_w
from procedures.restoration.masks.mask_fields import Masks
from procedures.restoration.unknown_motion.blind import prototype_shapes
from procedures.restoration.unknown_motion.path_refinement import MotionShapes, motion_of_scene

Array = npt.NDArray[np.float64]

MAX_W = 8.0
"""Half-width of the widest blur to expect, in pixels of the plane."""
DETAIL_PX = 8.0
"""Size of what counts as detail of a scene: larger is light and shade."""
CANDIDATES = 4
"""Parts of the picture that are tried as the one of a single depth, where none was marked."""


def shown(frame: RawFrame) -> Plane:
    """The plane that is restored."""
    return frame.planes.get("G1") or next(iter(frame.planes.values()))


def focal_px(frame: RawFrame, known: RestorationFacts) -> float:
    """The image's distance behind the lens in pixels of the plane that is restored; 0 where it is not known."""
    told = frame.exposure
    focal_mm, pitch_um = told.focal_length_mm, known.pixel_pitch_um
    if not focal_mm or not pitch_um:
        return 0.0
    # focused nearer, the image lies farther behind the lens (4.1)
    nearer = 1 - focal_mm / told.subject_distance_mm if told.subject_distance_mm else 1.0
    return focal_mm / max(nearer, 0.5) / (pitch_um * 1e-3 * shown(frame).pitch)


@dataclass(frozen=True)
class RigBlur:
    """Masks of each photograph, what their w is told in, and the motion they are of where the photographs gave it."""

    masks: Sequence[Masks]
    unit: Unit = field(default_factory=Unit)
    motion: MotionShapes | None = None


def masks(
    pictures: Sequence[Array],
    known: RestorationFacts,
    relation: tuple[float, float],
    exposures: Sequence[Poses] = (),
    focal: float = 0.0,
) -> RigBlur:
    """The blur of each photograph as a function of one w. Raises Refused, BadParameter.

    relation : ratio and offset of the second's w, see `blur_relation`.
    exposures : both recorded ones, where they are; focal : length in pixels, 0 for a rig that is taken not to turn.
    """
    max_w = MAX_W if known.max_w is None else known.max_w
    check_max_w(max_w)
    shape = (int(pictures[0].shape[1]), int(pictures[0].shape[2]))
    if known.blur_by == MOTIONS:
        if len(exposures) == len(pictures):
            return rig_masks(exposures, focal, shape, max_w)
        check_extent(reach_of_masks(max_w), shape)
        motion = motion_shapes(pictures, known.region, max_w)
        return RigBlur(stacks_of([*motion.shapes], (1.0,) * len(motion.shapes), max_w, shape), motion=motion)
    ratio, offset = relation
    return RigBlur(stacks_of([aperture(known.shape)] * 2, (1.0, ratio), max_w, shape, (0.0, offset)))


def aperture(name: str) -> Array:
    """The shape of an aperture by its name. Raises BadParameter."""
    found = named(name)
    if found is None:
        raise BadParameter(f"no aperture is called {name!r}", "use pillbox, gaussian or polygon:BLADES")
    return found


def rig_masks(exposures: Sequence[Poses], focal: float, shape: tuple[int, int], max_w: float) -> RigBlur:
    """Masks of recorded motion, and what w is told in: inverse depth where the focal length is known."""
    if not focal:
        stacks = planar_stacks([one.planar_path for one in exposures], max_w)
        check_extent(stacks[0].R, shape)
        return RigBlur(stacks)
    blur = motion_blur(exposures, focal, shape, max_w / px_per_inverse_m(exposures, focal, shape))
    return RigBlur(blur.fields, blur.unit)


def blur_relation(first: RawFrame, second: RawFrame, known: RestorationFacts) -> tuple[float, float]:
    """w of the second photograph is that of the first times a ratio, and an offset in pixels (4.8 to 4.10).

    Where the camera noted both distances of focus, by them too; else the focus is taken to be the same.
    """
    ratio = blur_ratio(known)
    lenses = lens(first, known.first_f_number, known), lens(second, known.second_f_number, known)
    if lenses[0] is None or lenses[1] is None or lenses[0].focus_mm == lenses[1].focus_mm:
        return ratio, 0.0
    alpha, beta = thin_lens.relation(lenses[0], lenses[1])
    # w counts from the plane of focus away from the camera, where radii are below zero
    return alpha, -beta


def lens(frame: RawFrame, f_number: float | None, known: RestorationFacts) -> thin_lens.CameraSetting | None:
    """Lens and focus of a photograph over pixels of the plane that is restored; None where something is not known."""
    told, pitch_um = frame.exposure, known.pixel_pitch_um
    focal_mm, focus_mm = told.focal_length_mm, told.subject_distance_mm
    if not (focal_mm and focus_mm and pitch_um and f_number) or focus_mm <= focal_mm:
        return None
    return thin_lens.CameraSetting(focal_mm, f_number, focus_mm, pitch_um * shown(frame).pitch)


def blur_ratio(known: RestorationFacts) -> float:
    """Blur of the second photograph over the first's: as the apertures, the focus being the same (4.8).

    Raises BadParameter where they are not known.
    """
    remedy = "tell both f-numbers in the step `scene`"
    first = required(known.first_f_number, "the first f-number", remedy)
    return first / required(known.second_f_number, "the second f-number", remedy)


def motion_shapes(pictures: Sequence[Array], region: str, max_w: float) -> MotionShapes:
    """The motions' shapes from a part of one depth: the one marked, or the first that a pair of masks explains."""
    largest = int(np.ceil(max_w))
    refusal: Refused | BadInput | None = None
    for x, y, width, height in marked(region) or parts(pictures[0][0], 32 * largest):
        try:
            cut = np.stack([one[0, y : y + height, x : x + width] for one in pictures])
            found = prototype_shapes(cut, largest)
            box = (x, y, cut.shape[2], cut.shape[1])
            return motion_of_scene([*pictures], box, found, max_w, np.random.default_rng(0))
        except (Refused, BadInput) as error:
            refusal = error
    raise Refused(
        f"no part of the photographs shows one motion each: {refusal.reason if refusal else 'they are too small'}",
        "mark a flat part of one distance with much detail",
    )


Box = tuple[int, int, int, int]


def marked(region: str) -> list[Box]:
    """The part that the operator marked, x, y, width, height; none for auto. Raises BadParameter."""
    if region.strip().lower() == "auto":
        return []
    try:
        x, y, width, height = (int(part) for part in region.split(","))
    except ValueError as error:
        raise BadParameter(
            f"a part is x,y,width,height in pixels; got {region!r}", "give four whole numbers"
        ) from error
    return [(x, y, width, height)]


def parts(picture: Array, side: int) -> Iterator[Box]:
    """Squares with the most detail in them, the best first, none overlapping another by more than half."""
    rows, columns = picture.shape
    side = min(side, rows, columns)
    fine = (picture - cv2.GaussianBlur(picture, (0, 0), DETAIL_PX)) ** 2
    places = [(x, y) for y in range(0, rows - side + 1, side // 2) for x in range(0, columns - side + 1, side // 2)]
    places.sort(key=lambda place: -float(fine[place[1] : place[1] + side, place[0] : place[0] + side].mean()))
    for x, y in places[:CANDIDATES]:
        yield x, y, side, side
