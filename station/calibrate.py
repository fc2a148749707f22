"""From a photograph of the chart to the records of its planes: what every way of calibrating shares."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from procedures.outcome import Outcome
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.quality import Diffraction
from procedures.raw import Exposure, Plane, RawFrame
from station.results import PlaneRecord

NUMBERS = ("gamma", "gamma_bound", "residual_std", "pixels_per_pattern", "s_over_t")
"""What a record takes from an estimate beside its PSF."""
WAVELENGTHS_NM = {"R": 600.0, "G": 530.0, "B": 460.0, "Y": 550.0}
"""Where a plane of usual colour filters is most sensitive."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """One plane's answer: what is recorded of it, and all that was found, None where it was refused."""

    record: PlaneRecord
    found: PatternPsf | None
    duration_s: float


def calibrate(
    frame: RawFrame,
    chart: Chart,
    parameters: PatternParameters,
    limit: Callable[[Plane], Diffraction | None] = lambda plane: None,
) -> Iterator[Calibrated]:
    """Every plane of a photograph in its order, several at a time; one that is refused does not keep the others.

    Parameters
    ----------
    limit : callable
        The diffraction limit of a plane, None where it is not known.
    """

    def estimate(plane: Plane) -> Calibrated:
        start = time.perf_counter()
        outcome = estimate_psf(plane, chart, parameters, limit(plane))
        return Calibrated(plane_record(plane.name, outcome), outcome.value, time.perf_counter() - start)

    with ThreadPoolExecutor(min(len(frame.planes), os.cpu_count() or 1)) as pool:
        yield from pool.map(estimate, frame.planes.values())


def plane_record(name: str, outcome: Outcome[PatternPsf]) -> PlaneRecord:
    """What is kept of an answer."""
    found = outcome.value
    if found is None:
        return PlaneRecord(name, outcome.verdict, outcome.reason, outcome.remedy)
    return PlaneRecord(
        name,
        outcome.verdict,
        outcome.reason,
        outcome.remedy,
        psf=found.psf,
        quality=found.quality,
        numbers={number: getattr(found, number) for number in NUMBERS},
        diagnostics=found.diagnostics,
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
