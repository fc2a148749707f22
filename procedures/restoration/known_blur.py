"""The blur of a plan's photographs, from the camera's data and the operator's answers."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

from procedures.outcome import BadInput, BadParameter
from procedures.plan import required
from procedures.raw import Plane, RawFrame
from procedures.restoration.colour.mosaic import is_mosaic
from procedures.restoration.facts import BOTH, COLOUR, MOTIONS, ORDER, SEARCH, RestorationFacts
from procedures.restoration.flat_part import region_of
from procedures.restoration.masks import thin_lens
from procedures.restoration.masks.blur_models import named
from procedures.restoration.masks.camera_motion import Poses, poses_of, poses_on
from procedures.restoration.masks.psf_shapes import MeasuredShape
from procedures.restoration.photograph_blur import (
    AdditionalDefocus,
    BlurSpec,
    KnownShapes,
    RecordedMotion,
    Shape,
    UnknownMotion,
)

ReadShape = Callable[[str, str | None, tuple[int, int] | None], Shape]
"""Reads a named shape for photographs (H, W) of a plane, or of any if None; raises ProcedureError."""


def split_ground_truth(frames: Sequence[RawFrame], known: RestorationFacts) -> tuple[list[RawFrame], RawFrame | None]:
    """The blurred photographs, and the ground truth where there is one."""
    each = [frames[n] for n in range(len(frames))]
    truth = next((frame for frame in each if known.truth_sha256 and frame.sha256 == known.truth_sha256), None)
    return [one for one in each if one is not truth], truth


def planes_of(frame: RawFrame, known: RestorationFacts) -> Mapping[str, Plane]:
    """The restored planes of a photograph: its whole mosaic, or one plane."""
    if known.colour == COLOUR and is_mosaic(frame.planes):
        return frame.planes
    return {frame.guide.name: frame.guide}


def named_shape(name: str, plane: str | None, size: tuple[int, int] | None) -> Shape:
    """A model's shape by its name. Raises BadParameter."""
    shape = named(name)
    if shape is None:
        raise BadParameter(f"no aperture is called {name!r}", "use pillbox, gaussian or polygon:BLADES")
    return shape


def shape_names(answer: str) -> tuple[str, ...]:
    """The names of shapes in an answer."""
    return tuple(part.strip() for part in answer.split(";"))


def shapes_over(frame: RawFrame, answer: str, known: RestorationFacts, read: ReadShape) -> tuple[Shape, ...]:
    """The shape of each photograph, or one for all, for photographs like this one. Raises ProcedureError."""
    plane = next(iter(planes_of(frame, known).values()))
    size = (int(plane.samples.shape[0]), int(plane.samples.shape[1]))
    shapes = {name: named_shape(name, None, None) if named(name) is not None else read(name, plane.name, size)
              for name in dict.fromkeys(shape_names(answer))}  # fmt: skip
    return tuple(shapes[name] for name in shape_names(answer))


def blur_spec(frames: Sequence[RawFrame], known: RestorationFacts, read: ReadShape = named_shape) -> BlurSpec:
    """The known blur of all photographs: given shapes, complete records, or motion to be estimated. Raises BadParameter
    if unknown."""
    if known.blur_by == MOTIONS and known.motion_shape != SEARCH:
        return BlurSpec(KnownShapes(shapes_over(frames[0], known.motion_shape, known, read)), known.max_w)
    if known.blur_by == BOTH:
        return motions_and_lens(frames, known, read)
    if known.blur_by == MOTIONS:
        recorded = recorded_motion(frames, focal_px(frames[0], known))
        if recorded is not None:
            return BlurSpec(recorded, known.max_w)
        return BlurSpec(unknown_motion(len(frames), known), known.max_w)
    each = [blur_relation(frames[0], frame, known, which) for frame, which in zip(frames, ORDER, strict=False)]
    ratios, offsets = (tuple(one) for one in zip(*each, strict=True))
    shapes = shapes_over(frames[0], known.shape, known, read)
    if len(shapes) > 1 and all(isinstance(shape, MeasuredShape) for shape in shapes) and not any(offsets):
        ratios = ()  # given by their half-widths
    each_one = shapes * (len(frames) // len(shapes))
    return BlurSpec(KnownShapes(each_one, ratios, offsets), known.max_w)


def motions_and_lens(frames: Sequence[RawFrame], known: RestorationFacts, read: ReadShape) -> BlurSpec:
    """Recorded motions with the lens's blur by inverse distance (4.5, 6.5). Raises BadParameter if a record or the lens
    is missing."""
    focal = focal_px(frames[0], known)
    recorded = recorded_motion(frames, focal)
    each = (lens(frame, known.lens_f_number, known) for frame in frames)
    settings = [setting for setting in each if setting is not None]
    if recorded is None:
        remedy = "repair shaker or IMU and take them again, or use motions alone"
        raise BadParameter("motions in addition to the lens's blur need a record of each photograph's motion", remedy)
    if focal is None or len(settings) < len(frames):
        remedy = "give f-number, distance of focus and pixel pitch; the camera must record the focal length"
        raise BadParameter("the lens's blur is not known", remedy)
    shapes = shapes_over(frames[0], known.shape, known, read)
    # in front of the plane of focus rays have not crossed: the shape is upside down, its half-width negative
    ratios = tuple(-one.scale_px_mm / 1000 for one in settings)
    offsets = tuple(one.scale_px_mm / one.focus_mm for one in settings)
    lens_blur = AdditionalDefocus(shapes * (len(frames) // len(shapes)), ratios, offsets)
    return BlurSpec(recorded, known.max_w, lens_blur)


def recorded_motion(frames: Sequence[RawFrame], focal: float | None) -> RecordedMotion | None:
    """The motion during all photographs, its common error within the largest bound; None where a record does not cover
    one."""

    def poses(late_s: float) -> tuple[Poses, ...]:
        each = [rig_poses(frame, late_s) for frame in frames]
        if any(one is None for one in each):
            raise BadInput("a record does not cover its exposure", "begin it earlier, end it later")
        return tuple(one for one in each if one is not None)

    with suppress(BadInput):
        records = [frame.shaker_path or frame.imu for frame in frames]
        within_s = max(0.0 if record is None else record.within_s for record in records)
        uncertainty = max(0.0 if one.shaker_path is None else one.shaker_path.amplitude_uncertainty for one in frames)
        return RecordedMotion(poses(0.0), focal, within_s=within_s, late=poses, scale_uncertainty=uncertainty)
    return None


def unknown_motion(photographs: int, known: RestorationFacts) -> UnknownMotion:
    """Motion to be estimated from the photographs. Raises BadParameter where their number does not allow it."""
    region = region_of(known.region)
    if photographs > 2 and region != "whole":
        raise BadParameter(
            f"a flat part determines the motion of two photographs, not of {photographs}, and not every one has a "
            "record of the IMU",
            "repair the IMU and take them again, or begin with two photographs or a flat scene",
        )
    return UnknownMotion(region)


def focal_px(frame: RawFrame, known: RestorationFacts) -> float | None:
    """Distance of the image behind the lens in pixels of the restored plane; None where it is not known."""
    camera = frame.exposure
    focal_mm, pitch_um = camera.focal_length_mm, known.pixel_pitch_um
    if not focal_mm or not pitch_um:
        return None
    # the closer the focus, the farther the image is behind the lens (4.1)
    nearer = 1 - focal_mm / camera.subject_distance_mm if camera.subject_distance_mm else 1.0
    return focal_mm / max(nearer, 0.5) / (pitch_um * 1e-3 * frame.guide.pitch)


def rig_poses(frame: RawFrame, late_s: float = 0.0) -> Poses | None:
    """Poses of the camera during an exposure, relative to rest, by the shaker's path, which has no drift, or an IMU's
    record `late_s` late; None without either."""
    open_s = frame.exposure.exposure_s
    if open_s is None:
        return None
    if frame.shaker_path is not None:
        with suppress(BadInput):
            return poses_on(frame.shaker_path, open_s, late_s)
    if frame.imu is not None:
        with suppress(BadInput):
            return poses_of(frame.imu, open_s, late_s)
    return None


def blur_relation(
    first: RawFrame, other: RawFrame, known: RestorationFacts, which: str = "second"
) -> tuple[float, float]:
    """Ratio and offset, pixels, of another photograph's w to the first's (4.8 to 4.10), by recorded distances of focus,
    else equal."""
    ratio = blur_ratio(known, which)
    lenses = lens(first, known.first_f_number, known), lens(other, known.f_numbers[which], known)
    if lenses[0] is None or lenses[1] is None or lenses[0].focus_mm == lenses[1].focus_mm:
        return ratio, 0.0
    alpha, beta = thin_lens.relation(lenses[0], lenses[1])
    # w is measured from the plane of focus away from the camera, where radii are negative
    return alpha, -beta


def lens(frame: RawFrame, f_number: float | None, known: RestorationFacts) -> thin_lens.CameraSetting | None:
    """Lens and focus of a photograph in pixels of the restored plane; None where something is not known."""
    camera, pitch_um = frame.exposure, known.pixel_pitch_um
    focal_mm, focus_mm = camera.focal_length_mm, camera.subject_distance_mm or 1000 * (known.focus_m or 0.0)
    if not (focal_mm and focus_mm and pitch_um and f_number) or focus_mm <= focal_mm:
        return None
    return thin_lens.CameraSetting(focal_mm, f_number, focus_mm, pitch_um * frame.guide.pitch)


def blur_ratio(known: RestorationFacts, which: str = "second") -> float:
    """Ratio of a photograph's blur to the first's by apertures (4.8). Raises BadParameter where they are unknown."""
    remedy = "give all f-numbers in the step `scene`"
    first = required(known.first_f_number, "the first f-number", remedy)
    return first / required(known.f_numbers[which], f"the {which} f-number", remedy)
