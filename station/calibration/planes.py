"""Results of planes from photographs: common to all PSF calibrations."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from procedures.cross_check.estimate import check_edges
from procedures.outcome import BadInput, BadParameter, Outcome, Refused, Verdict
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.quality import CAMERA, OPERATOR, WAVELENGTHS_NM, Diffraction
from procedures.raw import Exposure, Plane, RawFrame
from station.calibration.sensor_models import NO_SENSOR, StoredSensor
from station.common.progress import Progress, silent, threads
from station.results.limits import place_of
from station.results.plane_result import PlaneResult

if TYPE_CHECKING:
    from procedures.pattern_psf.combine import CombinedPsf
    from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf


F = TypeVar("F", bound="PatternPsf | CombinedPsf | TwoPhotoPsf")
Limit = Callable[[Plane], Diffraction | None]
"""The diffraction limit of a plane, None where it is not known."""


def calibrate(
    frame: RawFrame,
    chart: Chart,
    parameters: PatternParameters,
    limit: Limit = lambda plane: None,
    *,
    physics: bool = False,
    sensor: StoredSensor = NO_SENSOR,
    progress: Progress = silent,
) -> Iterator[PlaneResult]:
    """Every plane of a photograph in order; a refused plane does not affect the others.

    Raises BadParameter if `physics` is set and the diffraction limit of a plane is not known.

    progress : called, without a step, after every model of sensor and lens that was fitted
    physics : whether a model of sensor and lens is fitted to every PSF
    sensor : result of the sensor's calibration; planes without one are estimated without it
    """
    if physics:
        from procedures.physics.estimate import check_known, estimate_physics  # a slow import

        for plane in frame.planes.values():
            check_known(limit(plane))

    def estimate(plane: Plane) -> PlaneResult:
        start = time.perf_counter()
        outcome = estimate_psf(plane, chart, parameters, limit(plane), sensor=sensor.models.get(plane.name))
        result = plane_result(plane, outcome, frame.exposure)
        if outcome.value is not None:
            result = replace(result, edges=check_edges(plane, outcome.value))
            if plane.name in sensor.noise:
                result = replace(result, information=sensor.information(plane.name, outcome.value.psf))
            if physics:
                physical = estimate_physics(
                    outcome.value.psf, limit(plane), plane.pitch, lambda words: progress(f"{plane.name}: {words}", 0)
                )
                result = replace(result, physics=physical)
        return replace(result, duration_s=time.perf_counter() - start)

    yield from _side_by_side(estimate, list(frame.planes.values()))


def calibrate_wall(
    frames: Sequence[RawFrame], parameters: TwoPhotoParameters, limit: Limit = lambda plane: None
) -> Iterator[PlaneResult]:
    """Every plane of two or more photographs of one wall, in any order, as `calibrate` does. Raises BadInput if they
    have different planes."""
    first, *others = frames
    for other in others:
        if list(first.planes) != list(other.planes):
            raise BadInput(
                f"all photographs need the same planes; they have {', '.join(first.planes)} and "
                f"{', '.join(other.planes)}",
                "give photographs of one camera, in one format",
            )

    def estimate(plane: Plane) -> PlaneResult:
        start = time.perf_counter()
        outcome = _of_wall(frames, plane.name, parameters, limit(plane))
        taken = time.perf_counter() - start
        return replace(plane_result(plane, outcome, first.exposure), diffraction=limit(plane), duration_s=taken)

    yield from _side_by_side(estimate, list(first.planes.values()))


def _of_wall(
    frames: Sequence[RawFrame], name: str, parameters: TwoPhotoParameters, diffraction: Diffraction | None
) -> Outcome[TwoPhotoPsf]:
    """The outcome of one plane; refused where other settings than distance and focus differ."""
    from procedures.two_photo.several import estimate_psf_of_wall  # a slow import
    from procedures.two_photo.trust import check_settings

    try:
        for other in frames[1:]:
            check_settings(frames[0].exposure, other.exposure)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    return estimate_psf_of_wall([frame.planes[name] for frame in frames], parameters, diffraction)


def _side_by_side(estimate: Callable[[Plane], PlaneResult], planes: Sequence[Plane]) -> Iterator[PlaneResult]:
    workers = min(len(planes), threads())
    if workers == 1:  # a further thread would allocate its own memory
        yield from map(estimate, planes)
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(estimate, planes)


def plane_result(plane: Plane, outcome: Outcome[Any], exposure: Exposure | None = None) -> PlaneResult:
    """The result of an estimate (`PatternPsf` or `TwoPhotoPsf`); `exposure` is from the photograph's metadata."""
    estimate = outcome.value
    if estimate is None:
        return PlaneResult.of_outcome(plane.name, outcome, pitch=plane.pitch)
    return PlaneResult.of(
        plane.name,
        outcome.verdict,
        estimate.psf,
        estimate.quality,
        reason=outcome.reason,
        remedy=outcome.remedy,
        other_causes=outcome.other_causes,
        values=estimate.values,
        diagnostics=estimate.diagnostics,
        pitch=plane.pitch,
        estimate=estimate,
        inter_image=estimate.inter_image,
        choice=estimate.choice,
        variations=estimate.variations,
        diffraction=estimate.diffraction,
        place=_place(plane, estimate),
        exposure=exposure,
    )


def _place(plane: Plane, estimate: PatternPsf | CombinedPsf | TwoPhotoPsf) -> str:
    """Position of the chart in the frame; "" without a chart."""
    if not estimate.charts:
        return ""
    x, y = np.mean([np.nanmean(chart.marks, axis=0) for chart in estimate.charts], axis=0).tolist()
    rows, columns = plane.samples.shape
    return str(place_of(x, y, (rows, columns)))


def diffraction_limit(
    exposure: Exposure,
    plane: Plane,
    *,
    pixel_pitch_um: float | None,
    f_number: float | None = None,
    wavelength_nm: float | None = None,
    needed: bool = False,
) -> Diffraction | None:
    """A plane's diffraction limit; None, or if it is `needed` BadParameter with the missing options, without pitch and
    aperture."""
    aperture = f_number or exposure.f_number
    if pixel_pitch_um is None or not aperture:
        if needed:
            raise _missing(pitch=pixel_pitch_um is None, aperture=not aperture)
        return None
    by = OPERATOR if aperture != exposure.f_number else CAMERA
    return Diffraction(aperture, pixel_pitch_um * plane.pitch, wavelength_nm or WAVELENGTHS_NM[plane.name[0]], by)


def _missing(*, pitch: bool, aperture: bool) -> BadParameter:
    """The error for missing inputs of the physics of a PSF."""
    inputs = (
        (pitch, "the sensor's pitch", "--pixel-pitch-um"),
        (aperture, "the f-number, which the camera did not record", "--f-number"),
    )
    missing = [(words, option) for lacks, words, option in inputs if lacks]
    return BadParameter(
        f"the physics of a PSF needs {' and '.join(words for words, _ in missing)}",
        f"give {' and '.join(option for _, option in missing)} (in a procedure file under optics), or omit the "
        "physics (for a series with --no-physics)",
    )
