"""What camera and operator know of the blur of a plan's two photographs."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import numpy.typing as npt

from procedures.facts import required
from procedures.outcome import BadInput, BadParameter
from procedures.raw import Plane, RawFrame
from procedures.restoration.facts import MOTIONS, RestorationFacts
from procedures.restoration.flat_part import region_of
from procedures.restoration.masks import thin_lens
from procedures.restoration.masks.blur_models import named
from procedures.restoration.masks.camera_motion import Poses, poses_of, poses_on
from procedures.restoration.photograph_blur import (
    BlurSpec,
    KnownShapes,
    RecordedMotion,
    UnknownMotion,
)


def shown(frame: RawFrame) -> Plane:
    """The plane that is restored."""
    return frame.planes.get("G1") or next(iter(frame.planes.values()))


def blur_spec(first: RawFrame, last: RawFrame, known: RestorationFacts) -> BlurSpec:
    """What is known of the blur of both. Raises BadParameter where apertures or region are not known.

    Motion is that of the records where both photographs have one, and is left to be found where not.
    """
    if known.blur_by == MOTIONS:
        exposures = [poses for poses in (rig_poses(frame) for frame in (first, last)) if poses is not None]
        if len(exposures) == 2:
            return BlurSpec(RecordedMotion((*exposures,), focal_px(first, known)), known.max_w)
        return BlurSpec(UnknownMotion(region_of(known.region)), known.max_w)
    ratio, offset = blur_relation(first, last, known)
    return BlurSpec(KnownShapes((aperture(known.shape),) * 2, (1.0, ratio), (0.0, offset)), known.max_w)


def aperture(name: str) -> npt.NDArray[np.float64]:
    """The shape of an aperture by its name. Raises BadParameter."""
    found = named(name)
    if found is None:
        raise BadParameter(f"no aperture is called {name!r}", "use pillbox, gaussian or polygon:BLADES")
    return found


def focal_px(frame: RawFrame, known: RestorationFacts) -> float | None:
    """The image's distance behind the lens in pixels of the plane that is restored; None where it is not known."""
    told = frame.exposure
    focal_mm, pitch_um = told.focal_length_mm, known.pixel_pitch_um
    if not focal_mm or not pitch_um:
        return None
    # focused nearer, the image lies farther behind the lens (4.1)
    nearer = 1 - focal_mm / told.subject_distance_mm if told.subject_distance_mm else 1.0
    return focal_mm / max(nearer, 0.5) / (pitch_um * 1e-3 * shown(frame).pitch)


def rig_poses(frame: RawFrame) -> Poses | None:
    """Where the camera was during an exposure, about where its rig rests; None where no record tells.

    What a shaker was told comes before what was felt: it has no drift.
    """
    open_s = frame.exposure.exposure_s
    if open_s is None:
        return None
    with suppress(BadInput):
        if frame.carried is not None:
            return poses_on(frame.carried, open_s)
    with suppress(BadInput):
        if frame.felt is not None:
            return poses_of(frame.felt, open_s)
    return None


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
