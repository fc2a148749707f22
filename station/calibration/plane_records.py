"""From photographs to the records of their planes: what every way of calibrating shares."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from procedures.cross_check.estimate import check_edges
from procedures.outcome import BadInput, Outcome, Refused, Verdict
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.psf import Psf
from procedures.quality import WAVELENGTHS_NM, Diffraction, Quality
from procedures.raw import Exposure, Plane, RawFrame
from station.calibration.sensor_models import NO_SENSOR, KnownSensor
from station.results.result_files import PlaneRecord

if TYPE_CHECKING:
    from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf

NUMBERS = ("gamma", "gamma_bound", "residual_std", "pixels_per_pattern", "s_over_t")
"""What a record takes from an estimate beside its PSF."""
PAIR_NUMBERS = ("scale", "gain", "noise", "residual_std")
"""The same of two photographs."""


class Found(Protocol):
    """What every estimate of a PSF holds."""

    @property
    def psf(self) -> Psf:
        """The PSF."""

    @property
    def quality(self) -> Quality:
        """What it says about the camera."""

    @property
    def diagnostics(self) -> Mapping[str, float]:
        """What the verdict was drawn from."""


T = TypeVar("T")
F = TypeVar("F", bound=Found)
Limit = Callable[[Plane], Diffraction | None]
"""The diffraction limit of a plane, None where it is not known."""


@dataclass(frozen=True, eq=False)
class Calibrated(Generic[T]):
    """One plane's answer: what is recorded of it, and all that was found, None where it was refused."""

    record: PlaneRecord
    found: T | None
    duration_s: float


def calibrate(
    frame: RawFrame,
    chart: Chart,
    parameters: PatternParameters,
    limit: Limit = lambda plane: None,
    *,
    threads: int | None = None,
    physics: bool = False,
    sensor: KnownSensor = NO_SENSOR,
) -> Iterator[Calibrated[PatternPsf]]:
    """Every plane of a photograph in its order; one that is refused does not keep the others.

    Parameters
    ----------
    threads : int, optional
        Planes estimated at a time; by default as many as there are cores.
    physics : bool
        Whether a model of sensor and lens is fitted to every PSF.
    sensor : KnownSensor, optional
        What the sensor's own calibration tells; a plane that it does not tell of is estimated without.

    Raises
    ------
    BadParameter
        If it is, and the diffraction limit of a plane is not known.
    """
    if physics:
        from procedures.physics.estimate import check_known, estimate_physics  # it optimises: that import is slow

        for plane in frame.planes.values():
            check_known(limit(plane))

    def estimate(plane: Plane) -> Calibrated[PatternPsf]:
        start = time.perf_counter()
        outcome = estimate_psf(plane, chart, parameters, limit(plane), sensor=sensor.models.get(plane.name))
        record = plane_record(plane, outcome, NUMBERS)
        if outcome.value is not None:
            record = replace(record, edges=check_edges(plane, outcome.value))
            if plane.name in sensor.noise:
                record = replace(record, information=sensor.information(plane.name, outcome.value.psf))
            if physics:
                record = replace(record, physics=estimate_physics(outcome.value.psf, limit(plane), plane.pitch))
        return Calibrated(record, outcome.value, time.perf_counter() - start)

    yield from _side_by_side(estimate, list(frame.planes.values()), threads)


def calibrate_pair(
    a: RawFrame,
    b: RawFrame,
    parameters: TwoPhotoParameters,
    limit: Limit = lambda plane: None,
    *,
    threads: int | None = None,
) -> Iterator[Calibrated[TwoPhotoPsf]]:
    """Every plane of two photographs of one wall, in any order, as `calibrate` does.

    Raises
    ------
    BadInput
        If the two have different planes.
    """
    if list(a.planes) != list(b.planes):
        raise BadInput(
            f"both photographs need the same planes; they have {', '.join(a.planes)} and {', '.join(b.planes)}",
            "give two photographs of one camera, in one format",
        )

    def estimate(plane: Plane) -> Calibrated[TwoPhotoPsf]:
        start = time.perf_counter()
        outcome = _of_pair(a, b, plane.name, parameters, limit(plane))
        record = replace(plane_record(plane, outcome, PAIR_NUMBERS), diffraction=limit(plane))
        return Calibrated(record, outcome.value, time.perf_counter() - start)

    yield from _side_by_side(estimate, list(a.planes.values()), threads)


def _of_pair(
    a: RawFrame, b: RawFrame, name: str, parameters: TwoPhotoParameters, diffraction: Diffraction | None
) -> Outcome[TwoPhotoPsf]:
    """The answer of one plane; refused where the camera noted that more than distance and focus changed."""
    from procedures.two_photo.estimate import estimate_psf as estimate_psf_of_pair  # charts do not need them
    from procedures.two_photo.trust import check_settings

    try:
        check_settings(a.exposure, b.exposure)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    return estimate_psf_of_pair(a.planes[name], b.planes[name], parameters, diffraction)


def _side_by_side(
    estimate: Callable[[Plane], Calibrated[T]], planes: Sequence[Plane], threads: int | None
) -> Iterator[Calibrated[T]]:
    with ThreadPoolExecutor(min(len(planes), threads or os.cpu_count() or 1)) as pool:
        yield from pool.map(estimate, planes)


def plane_record(plane: Plane, outcome: Outcome[F], numbers: Sequence[str]) -> PlaneRecord:
    """What is kept of an answer; `numbers` are the names of what it holds beside PSF and quality."""
    found = outcome.value
    if found is None:
        return PlaneRecord(plane.name, outcome.verdict, outcome.reason, outcome.remedy, pitch=plane.pitch)
    return PlaneRecord(
        plane.name,
        outcome.verdict,
        outcome.reason,
        outcome.remedy,
        psf=found.psf,
        quality=found.quality,
        numbers={number: getattr(found, number) for number in numbers},
        diagnostics=found.diagnostics,
        inter_image=getattr(found, "inter_image", None),
        pitch=plane.pitch,
        choice=getattr(found, "choice", ()),
        variations=getattr(found, "variations", ()),
        diffraction=getattr(found, "diffraction", None),
    )


def diffraction_limit(
    exposure: Exposure,
    plane: Plane,
    *,
    pixel_pitch_um: float | None,
    f_number: float | None = None,
    wavelength_nm: float | None = None,
) -> Diffraction | None:
    """A plane's diffraction limit, where pitch and aperture are known."""
    aperture = f_number or exposure.f_number
    if pixel_pitch_um is None or not aperture:
        return None
    return Diffraction(aperture, pixel_pitch_um * plane.pitch, wavelength_nm or WAVELENGTHS_NM[plane.name[0]])
