"""Computation of a restoration by its settings: blur, descent, distances, record."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from procedures.numbers import ENERGY_OUTSIDE_SUPPORT
from procedures.outcome import BadParameter, Outcome, Verdict
from procedures.raw import RawFrame, read_photograph
from procedures.restoration.colour.mosaic import is_mosaic
from procedures.restoration.first_depth.registration import register
from procedures.restoration.flat_part import region_of
from procedures.restoration.ground_truth import check_ground_truth, compare_to_ground_truth
from procedures.restoration.joint.joint_descent import JointRound
from procedures.restoration.joint.result import Restoration
from procedures.restoration.masks.blur_models import named, spread_of
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.checks import check_photographs, trust_of
from procedures.restoration.masks.mask_fields import MaskField, Masks
from procedures.restoration.masks.psf_shapes import MeasuredShape
from procedures.restoration.masks.thin_lens import CameraSetting, relation
from procedures.restoration.metres import CameraUncertainty, Distances, depth_spread, distances_of
from procedures.restoration.photograph_blur import (
    AdditionalDefocus,
    BlurSpec,
    Finding,
    KnownShapes,
    RecordedMotion,
    SceneBlur,
    Shape,
    UnknownMotion,
    blur_of,
)
from procedures.restoration.unknown_motion.blind import Prototypes, SearchRound
from procedures.restoration.unknown_motion.flat_scene import FreeKernels
from procedures.restoration.unknown_motion.recorded_paths import read_path
from station.calibration.restoration import developed
from station.calibration.restoration.inputs import (
    caveat_of,
    poses_of_records,
    read_blur_shape,
    read_kernels,
    read_poses,
)
from station.common.progress import Progress
from station.common.sanitise import encodable
from station.procedure.restore_settings import RestoreSettings
from station.reports.restoration_files import Restored, restoration_measurement
from station.results.measurement import Measurement
from station.results.record_head import RecordHead, files_read

MIN_DETERMINED = 0.3
"""Smallest fraction of the frame with a distance: there is none at depth edges, and where there is no texture."""


def restored(name: str, paths: Sequence[Path], settings: RestoreSettings, progress: Progress) -> Measurement:
    """Picture and depth of the photographs."""
    settings = settings.of(paths)
    settings.check_for(len(paths))
    frames = [settings.read(path) for path in paths]
    photographs: list[Array] = [np.stack([p.samples.astype(np.float64) for p in f.planes.values()]) for f in frames]
    check_photographs(photographs)
    truth = None if settings.reference is None else _ground_truth(settings, settings.reference, frames)
    lenses = _lenses(settings, frames) if settings.metres else []
    blurred = _with_lenses(settings, lenses) if lenses else settings
    spec = _spec(blurred, frames, photographs)
    for one in _measured(spec):
        progress(f"measured half-width {one.half_width_px:.2f} pixels; {one.cut:.1%} negative light excluded", 0)
    blur = blur_of(spec, photographs, lambda motion: progress(_finding(motion), 0))
    share = 100 // (settings.parameters.scheme.rounds + 1)

    def report(done: JointRound) -> None:
        progress(f"round {done.n}: {done.what}, cost {done.cost:.4g}, residual {done.residual * 255:.3f}/255", share)

    outcome = blur.restored(photographs, settings.parameters, report)
    if is_mosaic(frames[0].planes) and outcome.value is not None:
        outcome = blur.coloured(outcome, [frame.planes for frame in frames])
    distances = None
    if lenses and outcome.value is not None:
        w, distances = _distances(outcome.value, photographs, blur.masks, lenses, settings)
        # one depth in every file: distances follow from w.npy by the lens equation
        outcome = _judged(replace(outcome, value=replace(outcome.value, w=w)), distances)
    outcome = developed.judged(outcome, frames)
    if truth is not None:
        outcome = compare_to_ground_truth(outcome, [one.planes for one in frames], truth.planes)
    given = {
        **_blur_record(settings, frames, spec, blur), **(_lens_record(settings, lenses) if lenses else {}),
        "planes": list(frames[0].planes), **_encoding(frames),
        **({"reference": str(settings.reference), "reference_sha256": truth.sha256} if truth else {}),
        **settings.descent, **({"raw": str(settings.layout)} if settings.raw else {}), **_file_record(settings),
    }  # fmt: skip
    head = RecordHead(name, files_read(frames), given)
    whole = Restored(outcome, photographs, distances)
    measurement = restoration_measurement("+".join(frames[0].planes), whole, head)
    picture = None if outcome.value is None else outcome.value.sharp
    files = {**measurement.files, **developed.picture_file(frames[0], picture, words="restored picture")}
    return replace(measurement, files=files, exposure=frames[0].exposure)


def _encoding(frames: Sequence[RawFrame]) -> dict[str, Any]:
    """Tone curves of developed pictures; empty for linear samples of a sensor."""
    names = dict.fromkeys(frame.development.curve.name for frame in frames if frame.development)
    return {"encoding": " and ".join(names)} if names else {}


def _ground_truth(settings: RestoreSettings, path: Path, frames: Sequence[RawFrame]) -> RawFrame:
    """A photograph of the same planes. Raises BadInput where it cannot be compared with them."""
    names = list(frames[0].planes)
    plane = names[0] if len(names) == 1 else "all"
    truth = msgspec.structs.replace(settings, plane=plane).read(path)
    check_ground_truth([frame.planes for frame in frames], truth.planes)
    return truth


def _spec(settings: RestoreSettings, frames: list[RawFrame], photographs: list[Array]) -> BlurSpec:
    count, source = len(frames), _source(settings, frames, photographs)
    if settings.blur != "both":
        return BlurSpec(source, settings.max_w)
    ratios, offsets = (_repeated(one, count) for one in (settings.defocus_ratio, settings.defocus_offset or (0.0,)))
    shapes = _shapes(settings.defocus_shape, frames, photographs, None)
    return BlurSpec(source, settings.max_w, AdditionalDefocus(shapes, (*ratios,), (*offsets,)))


def _source(
    settings: RestoreSettings, frames: list[RawFrame], photographs: list[Array]
) -> KnownShapes | RecordedMotion | UnknownMotion:
    if settings.poses:
        poses = tuple(read_poses(Path(pose)) for pose in settings.poses)
        return RecordedMotion(poses, settings.focal_px, settings.max_inverse_depth)
    if settings.imu:
        late = partial(poses_of_records, [Path(one) for one in settings.imu], _exposures(settings, frames))
        return RecordedMotion(
            late(), settings.focal_px, settings.max_inverse_depth, settings.imu_within_s, lambda late_s: late(late_s)
        )
    ratios = _later(settings.ratio, 1.0, len(frames))
    if settings.prototype_region is not None:
        paths = tuple(read_path(Path(one)) for one in settings.recorded_path)
        kernels, caveat = read_kernels([Path(one) for one in settings.shape])
        return UnknownMotion(region_of(settings.prototype_region), paths, ratios, kernels, caveat)
    samples = settings.samples_per_pixel
    shapes = _shapes(settings.shape, frames, photographs, samples if isinstance(samples, int) else None)
    return KnownShapes(shapes, ratios, _later(settings.offset, 0.0, len(frames)), caveat_of(settings.shape))


def _exposures(settings: RestoreSettings, frames: list[RawFrame]) -> list[float | None]:
    """Exposure times in seconds, as given, or as recorded in the files."""
    return _repeated(settings.exposure_s, len(frames)) or [frame.exposure.exposure_s for frame in frames]


def _later(given: tuple[float, ...], first: float, count: int) -> tuple[float, ...]:
    """One value per photograph, from those after the first, the last of which is repeated; none if none is given."""
    return (first, *given, *(given[-1:] * count))[:count] if given else ()


def _repeated(given: tuple[Any, ...], count: int) -> list[Any]:
    """One value per photograph, from one for each or one for all."""
    return [*given] * (1 if len(given) == count else count)


def _shapes(
    names: tuple[str, ...], frames: list[RawFrame], photographs: list[Array], samples_per_px: int | None
) -> tuple[Shape, ...]:
    plane, size = next(iter(frames[0].planes)), (photographs[0].shape[1], photographs[0].shape[2])
    return tuple(read_blur_shape(name, plane, size, samples_per_px) for name in _repeated(names, len(frames)))


def _measured(spec: BlurSpec) -> list[MeasuredShape]:
    shapes = spec.source.shapes if isinstance(spec.source, KnownShapes) else ()
    return [shape for shape in shapes if isinstance(shape, MeasuredShape)]


def _finding(motion: Finding) -> str:
    """An estimate of unknown motion, or a round of its search, in words."""
    if isinstance(motion, SearchRound):
        return f"search of the motion: round {motion.n} of at most {motion.most}"
    if isinstance(motion, FreeKernels):
        return motion.caveat or f"motions of any form within {motion.half_width:.0f} pixels each way"
    if isinstance(motion, Prototypes):
        return (
            f"motion of half-width {motion.half_width:.1f} pixels in the flat part; the search for the paths that "
            "agree with the whole frame takes about a minute"
        )
    return motion.caveat or f"paths of half-width {motion.half_width:.2f} pixels in the flat part"


def _lenses(settings: RestoreSettings, frames: Sequence[RawFrame]) -> list[CameraSetting]:
    """Lens and focus of each photograph, in pixels of the plane. Raises BadParameter where something is missing."""
    lenses, typed = [], [_repeated(each, len(frames)) for each in (settings.focus_m, settings.f_number)]
    for n, frame in enumerate(frames):
        recorded = frame.exposure
        focus_m, f_number = (each[n] if each else None for each in typed)
        known = {
            "--focal-length-mm": settings.focal_length_mm or recorded.focal_length_mm,
            "--f-number": f_number or recorded.f_number,
            "--focus-m": 1000 * focus_m if focus_m else recorded.subject_distance_mm,
            "--pixel-pitch-um": settings.pixel_pitch_um,
        }
        lacking = ", ".join(option for option, value in known.items() if not value)
        if lacking:
            raise BadParameter(f"photograph {n + 1} does not record all data for metres", f"give {lacking}")
        focal, number, focus_mm, pitch = (float(value or 0) for value in known.values())
        pitch_um = pitch * next(iter(frame.planes.values())).pitch
        lenses.append(CameraSetting(focal, number, focus_mm, pitch_um, spread_of(settings.shape[0])))
    return lenses


def _sizes(settings: RestoreSettings, lenses: Sequence[CameraSetting]) -> list[tuple[float, float]]:
    """Ratio and offset of every photograph's blur, from the camera's data (4.8 to 4.10)."""
    # radii are positive in front of the plane of focus; behind it w is their negative
    side = 1 if settings.metres == "front" else -1
    related = [relation(lenses[0], lens) for lens in lenses]
    return [(alpha, side * beta if abs(beta) > 1e-9 else 0.0) for alpha, beta in related]


def _with_lenses(settings: RestoreSettings, lenses: Sequence[CameraSetting]) -> RestoreSettings:
    """The settings with these ratios and offsets."""
    ratios, offsets = zip(*_sizes(settings, lenses)[1:], strict=True)
    return msgspec.structs.replace(settings, ratio=ratios, offset=offsets if any(offsets) else ())


def _distances(
    restoration: Restoration, photographs: Sequence[Array], masks: Sequence[Masks], lenses: Sequence[CameraSetting],
    settings: RestoreSettings,
) -> tuple[Array, Distances]:  # fmt: skip
    """w (H, W) without the masks' bias, and the distances from it."""
    z, shape = np.stack(photographs), named(settings.shape[0])
    aligned = register(z, trust_of(z), masks).z
    assert shape is not None, "settings with metres have a shape by name"
    w, spread = depth_spread(restoration, list(aligned), masks, shape, _sizes(settings, lenses))
    known = CameraUncertainty(settings.camera_uncertainty, settings.camera_uncertainty)
    return w, distances_of(w, spread, lenses[0], str(settings.metres), known)


def _judged(outcome: Outcome[Restoration], distances: Distances) -> Outcome[Restoration]:
    """The outcome, doubtful where the distance of most of the frame is undetermined."""
    if distances.determined >= MIN_DETERMINED or outcome.reason:
        return outcome
    reason = f"only {distances.determined:.0%} of the frame have a distance, as texture or blur are insufficient"
    remedy = "put structure into the scene, or open the lens"
    return replace(outcome, verdict=Verdict.DOUBTFUL, reason=reason, remedy=remedy)


def _lens_record(settings: RestoreSettings, lenses: Sequence[CameraSetting]) -> dict[str, Any]:
    return {
        "metres": settings.metres,
        "f_number": [lens.f_number for lens in lenses],
        "focus_m": [lens.focus_mm / 1000 for lens in lenses],
        "focal_length_mm": lenses[0].focal_length_mm,
        "pixel_pitch_um": settings.pixel_pitch_um,
        "camera_uncertainty": settings.camera_uncertainty,
    }


def _file_record(settings: RestoreSettings) -> dict[str, Any]:
    files = [
        {"path": encodable(str(path)), "sha256": hashlib.sha256(read_photograph(path)).hexdigest()}
        for path in settings.files
    ]
    return {"files": files} if files else {}


def _blur_record(settings: RestoreSettings, frames: list[RawFrame], spec: BlurSpec, blur: SceneBlur) -> dict[str, Any]:
    """The settings of the blur, and what was estimated of it."""
    entries: dict[str, Any] = {
        "blur": settings.blur,
        "prototype_region": settings.prototype_region,
        "shape": list(settings.shape),
        "recorded_path": list(settings.recorded_path),
    }
    if settings.imu:
        entries |= {"imu": list(settings.imu), "exposure_s": _exposures(settings, frames)}
    elif settings.poses:
        entries |= {"poses": list(settings.poses)}
    entries |= _source_record(spec, blur)
    if spec.defocus is not None:
        entries["defocus_shape"] = _repeated(settings.defocus_shape, len(spec.defocus.shapes))
        entries["defocus_ratio"] = list(spec.defocus.ratios)
        entries["defocus_offset"] = list(spec.defocus.offsets)
    if (motion := blur.motion) is not None:
        paths = None if motion.path is None else motion.path[:, ::8].round(3).tolist()
        entries["motion"] = {"half_width_px": motion.half_width, "paths_px": paths, "caveat": motion.caveat}
    return entries


def _source_record(spec: BlurSpec, blur: SceneBlur) -> dict[str, Any]:
    source = spec.source
    if isinstance(source, RecordedMotion):
        masks = MaskField.of(blur.masks[0])
        given = {"focal_px": source.focal_px, "max_inverse_depth": source.max_inverse_m}
        fitted = {} if blur.time_shift is None else {"time_shift": asdict(blur.time_shift)}
        if source.scale_uncertainty:
            given["inverse_depth_scale_uncertainty"] = source.scale_uncertainty
        return {**given, **fitted, "nodes": list(masks.grid), "half_size": masks.R}
    entries: dict[str, Any] = {"ratio": list(blur.ratios[1:]), "max_w": blur.max_w}
    if isinstance(source, KnownShapes) and any(source.offsets):
        entries["offset"] = list(source.offsets[1:])
    measured = [
        {
            "half_width_px": one.half_width_px,
            "negative_light": one.cut,
            ENERGY_OUTSIDE_SUPPORT: one.energy_outside_support,
        }
        for one in _measured(spec)
    ]
    return {**entries, "measured": measured} if measured else entries
