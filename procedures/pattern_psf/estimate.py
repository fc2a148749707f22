"""The PSF from one photograph of the noise chart, start to end: a number with its error bar, or a refusal.

References
----------
Delbracio, Muse, Almansa, IPOL 2012, section 4; Delbracio's thesis, chapter 2 and appendix A.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from procedures.budget import taken_apart, with_settling
from procedures.choice import FINEST, START_S, Trial, choose, settling
from procedures.numbers import (
    GAMMA,
    GAMMA_BOUND,
    MTF50_HORIZONTAL,
    MTF50_VERTICAL,
    PIXELS_PER_PATTERN,
    RESIDUAL_STD,
    S_OVER_T,
)
from procedures.numerics.kernel_tail import far_light
from procedures.outcome import Outcome, Refused, Verdict, verdict_of
from procedures.pattern import AIM_S_OVER_T, BLOCK, CELLS, GOOD_S_OVER_T, Chart
from procedures.pattern_psf.chart_finding.detection import ChartSighting, check_usable, find_chart
from procedures.pattern_psf.correspondences import Correspondences, correspondences
from procedures.pattern_psf.diagnostics import Diagnostics, diagnose
from procedures.pattern_psf.error_parts import CALIBRATED, GROUPS, ErrorParts, Variation, error_parts
from procedures.pattern_psf.gamma.amplification import gamma_bound, gamma_of_fit
from procedures.pattern_psf.observation import Observation, count_inside, noise_window, observe, surroundings
from procedures.pattern_psf.outliers import LeftOut, left_out, swept, within_reach, without_outliers, without_places
from procedures.pattern_psf.radiometry import Light, bend_of_chart, measure_light, straighten, with_sensor
from procedures.pattern_psf.refine import GEOMETRY, ChartFit, TailPrior, first_look, refine
from procedures.pattern_psf.registration import (
    Registration,
    block_size_px,
    mark_residuals,
    refine_corners,
    register_marks,
)
from procedures.pattern_psf.solution import SharedErrors, solution
from procedures.pattern_psf.trust import Doubts, check_cells, check_light, checks_of, misfits
from procedures.psf import Psf, Sampling
from procedures.quality import Diffraction, Quality, assess, beyond_diffraction
from procedures.raw import Plane
from procedures.sensor_model import SensorModel
from procedures.sharpening.paper import look_at_noise

Array = npt.NDArray[np.float64]


WATCHED = (MTF50_HORIZONTAL, MTF50_VERTICAL)
"""The numbers that must be the same all over the chart."""
PUPIL_SPREAD = 0.1
"""Standard uncertainty of the far tail that f-number and pitch tell, over it: a colour's spread of wavelengths, pupils
that are no circles or partly shaded, f-numbers as they are rounded."""
SAMPLES_PER_CELL = 2.0
"""Largest s/t that is chosen, where the camera passes more than a smaller one holds: the cells' own spectrum is zero
there at the band's edge."""
MOST_LOOKS = 10
"""How often places that something else hides are left out, one after the other."""
LEAST_SEEN = 0.5
"""Share of the noise region's samples that must show the chart where places are left out."""


@dataclass(frozen=True)
class PatternParameters(Sampling):
    """How the PSF is sampled and solved for: see `Sampling`; k of 3 s + 1 to 6 s + 1 is usual.

    Attributes
    ----------
    chosen : bool
        Whether s and k, where they are given, were chosen from another photograph: they are not doubted then.
    """

    s: int | None = None
    k: int | None = None
    solver: str = "ls"
    at: tuple[float, ...] = ()
    chosen: bool = False


@dataclass(frozen=True)
class PatternPsf:
    """The calibrated PSF of one plane at one place of the frame.

    Attributes
    ----------
    psf : Psf
    n : int
        Number of samples it was estimated from.
    quality : Quality
        MTF and the numbers drawn from the PSF, with the budgets of their uncertainties.
    diffraction : Diffraction or None
        What limits the plane, where it is known.
    gamma, gamma_bound : float
        Noise amplification sum 1 / sigma_i^2 of the photograph as the thesis defines it, and the smallest that any
        chart could have: see `pattern_psf.gamma`.
    residual_std : float
        Residual in units of the noise measured on the blocks.
    pixels_per_pattern : float
        Width of the noise region in pixels of the plane.
    s_over_t : float
        Sampling ratio; 1 is ideal.
    choice : tuple of Trial
        What was tried of s and k; the last one is this.
    variations : tuple of Variation
        MTF50 in the halves of the chart.
    registration : Registration
        Where every pixel lies on the chart.
    centre_covariance : (2, 2) float64
        Of the place (x, y) in the plane, in pixels, where a mark at the chart's centre would be seen: where the
        registration has it, plus the `mark_offset` of the PSF, which the last step leaves at its noise.
    diagnostics : mapping of str to float
    marks : (12, 2) float64
        The x-corners as found, (x, y) in pixels, NaN where hidden.
    residual : (rows, columns) float64
        Photograph minus prediction in units of the noise, over the noise region; NaN where no sample was used.
    residual_origin : (int, int)
        Pixel (x, y) of the plane at which `residual` begins.
    correspondences : Correspondences
        Where parts of the chart are seen, each measured by its own cells: what geometry is made of.
    shared : SharedErrors
        What the errors of PSF, centre and these parts have in common.
    """

    psf: Psf
    n: int
    quality: Quality
    diffraction: Diffraction | None
    gamma: float
    gamma_bound: float
    residual_std: float
    pixels_per_pattern: float
    s_over_t: float
    choice: tuple[Trial, ...]
    variations: tuple[Variation, ...]
    registration: Registration
    centre_covariance: Array
    diagnostics: Mapping[str, float]
    marks: Array
    residual: Array
    residual_origin: tuple[int, int]
    correspondences: Correspondences
    shared: SharedErrors

    @property
    def charts(self) -> tuple[PatternPsf, ...]:
        """The estimates from single photographs of a chart that it is made of: itself."""
        return (self,)

    @property
    def inter_image(self) -> None:
        """One photograph has none."""

    @property
    def values(self) -> dict[str, float]:
        """The numbers that have no uncertainty."""
        return {
            GAMMA: self.gamma,
            GAMMA_BOUND: self.gamma_bound,
            RESIDUAL_STD: self.residual_std,
            PIXELS_PER_PATTERN: self.pixels_per_pattern,
            S_OVER_T: self.s_over_t,
        }


def estimate_psf(
    plane: Plane,
    chart: Chart,
    parameters: PatternParameters | None = None,
    diffraction: Diffraction | None = None,
    sighting: ChartSighting | None = None,
    sensor: SensorModel | None = None,
) -> Outcome[PatternPsf]:
    """The PSF of a plane that shows the chart, or the reason why it has none.

    Parameters
    ----------
    plane : Plane
        Linear samples, black 0, white 1; the chart may lie anywhere in it.
    chart : Chart
        The cells that were printed.
    parameters : PatternParameters, optional
    diffraction : Diffraction, optional
        What limits this plane: where it is given, the Strehl ratio is reported too.
    sighting : ChartSighting, optional
        The chart to use, of several in the photograph (`detection.find_charts`); None: the only one is found.
    sensor : SensorModel, optional
        What the sensor's own calibration tells: its response is undone and not fitted, its noise weighs the samples.

    Returns
    -------
    Outcome[PatternPsf]
        Refused outcomes carry the reason and the remedy and no value; poor photographs raise nothing.
    """
    parameters = parameters or PatternParameters()
    try:
        return _estimate(plane, chart, parameters, diffraction, sighting, sensor)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    except np.linalg.LinAlgError:
        return Outcome(
            None,
            Verdict.REFUSED,
            f"the photograph must determine the PSF's values {_asked(parameters)}; it does not",
            f"photograph the chart from a distance where s/t is near {AIM_S_OVER_T:g}, or lower s or k",
        )


def finest(cell_px: float, most: float = SAMPLES_PER_CELL) -> int:
    """The largest s, of at most so many samples in a cell, for cells of a side in pixels."""
    return int(np.clip(np.floor(most / cell_px + 1e-9), 2, FINEST))


def _asked(parameters: PatternParameters) -> str:
    """The sampling asked for, in words."""
    return f"at s = {parameters.s or 'auto'}, k = {parameters.k or 'auto'}"


def _estimate(
    plane: Plane,
    chart: Chart,
    parameters: PatternParameters,
    diffraction: Diffraction | None,
    sighting: ChartSighting | None,
    sensor: SensorModel | None,
) -> Outcome[PatternPsf]:
    """The chain itself; raises Refused."""
    plane = plane if sensor is None else straighten(plane, sensor)
    samples = plane.samples
    corners, marks_map = _register(samples, sighting)
    light = measure_light(samples, marks_map, plane.quantisation)
    check_light(light, plane.quantisation)
    light = light if sensor is None else with_sensor(light, sensor, plane)
    known = _Known(
        None if diffraction is None else TailPrior(diffraction.tail_density_px, PUPIL_SPREAD),
        None if sensor is None else bend_of_chart(light, sensor, plane),
    )
    best = marks_map

    def attempt(s: int, k: int) -> _Attempt:
        nonlocal best
        fit, lost = _fit(samples, chart, corners, best, light, s, k, known)
        check_cells(fit)
        if fit.still:
            best = fit.registration
        solved = solution(fit, s, k, parameters.solver)
        return _Attempt(fit, lost, solved.psf, solved.centre_covariance, solved.shared)

    cell_px = block_size_px(marks_map) / BLOCK
    count = count_inside(marks_map, noise_window(marks_map, samples.shape))
    first_s = min(START_S, finest(cell_px, GOOD_S_OVER_T[1]))
    found, tried = choose(
        attempt, lambda one: one.psf, count, finest(cell_px), start_s=first_s, s=parameters.s, k=parameters.k
    )
    quality = assess(found.psf, n=len(found.fit.observation), diffraction=diffraction, at=parameters.at)
    parts = error_parts(found.fit, found.psf, quality, WATCHED, GROUPS if sensor is None else CALIBRATED)
    quality = taken_apart(with_settling(quality, settling(tried)), parts.parts)
    around = surroundings(found.fit.registration, samples.shape).cut(samples)
    levels = float(light.black[0]), float(light.white[0])
    noise = look_at_noise(around, levels, light.variance_at, _residual_picture(found.fit)[0])
    diagnostics = diagnose(
        found.fit, found.psf, light, corners, marks_map, found.lost, parts, known.tail, tried[-1], noise
    )
    contradicted = beyond_diffraction(quality, diffraction)
    more = Doubts(parameters, parameters.chosen, tried, parts.variations, contradicted, sensor, plane.raw)
    result = _result(found, quality, parts, tried, diagnostics, corners, diffraction)
    return verdict_of(checks_of(diagnostics, found.fit, more), result)


@dataclass(frozen=True)
class _Known:
    """What is known before the fit: the far tail, by diffraction; beta's uncertainty, by the sensor's calibration."""

    tail: TailPrior | None
    bend: float | None


@dataclass(frozen=True)
class _Attempt:
    """The joint fit at one s and k, what it goes without, its PSF with the centre's covariance, what errors
    share."""

    fit: ChartFit
    lost: LeftOut
    psf: Psf
    centre_covariance: Array
    shared: SharedErrors


def _register(samples: npt.NDArray[np.float32], sighting: ChartSighting | None) -> tuple[Array, Registration]:
    """The chart's marks to subpixel, and the map they give."""
    if sighting is None:
        sighting = find_chart(samples)
    else:
        check_usable(sighting, samples.shape)
    block = block_size_px(register_marks(sighting.corners))
    corners = refine_corners(samples, sighting.corners, block)
    registration = register_marks(corners)
    worst = float(np.linalg.norm(mark_residuals(registration, corners), axis=1).max())
    if worst > 0.25 * block:
        raise Refused(
            f"the chart's marks must lie on one plane; one is {worst:.1f} pixels off",
            "keep the marks free of reflections and shadows, and lay the chart flat",
        )
    return corners, registration


def _fit(
    samples: npt.NDArray[np.float32],
    chart: Chart,
    corners: Array,
    registration: Registration,
    light: Light,
    s: int,
    k: int,
    known: _Known,
) -> tuple[ChartFit, LeftOut]:
    """The joint fit, and the samples left out of it as outliers."""
    window = noise_window(registration, samples.shape)
    hidden = not np.isfinite(corners).all()
    whole = observe(samples, registration, light, window, margin_px=k / (2 * s) if hidden else 0.0)
    observation = within_reach(whole)
    m, n = len(whole), k * k
    if m < 2 * n:
        raise Refused(
            f"{n} PSF values need at least {2 * n} samples of the noise region; the photograph has {m}",
            "move closer, or lower k",
        )
    levels = float(light.black[0]), float(light.white[0])
    far = far_light(samples, (window.x, window.y), (window.rows, window.columns), s, k, levels)

    def fitted(some: Observation) -> ChartFit:
        return refine(some, chart, registration, window, s, k, far, known.tail, known.bend)

    def looked(some: Observation) -> ChartFit:
        return first_look(some, chart, registration, window, s, k)

    fit = swept(fitted(observation), fitted, without_outliers, 2 * n)
    if misfits(fit):  # what is hidden in places may leave enough to see
        clear = swept(looked(observation), looked, without_places, 2 * n, MOST_LOOKS)
        clear = swept(fitted(clear.observation), fitted, without_places, 2 * n)
        clear = swept(clear, fitted, without_outliers, 2 * n)
        fit = fit if misfits(clear) or len(clear.observation) < LEAST_SEEN * m else clear
    return fit, left_out(whole, fit.observation)


def _result(
    found: _Attempt,
    quality: Quality,
    parts: ErrorParts,
    tried: tuple[Trial, ...],
    d: Diagnostics,
    corners: Array,
    diffraction: Diffraction | None,
) -> PatternPsf:
    """Everything that is reported, from the final fit."""
    fit, psf = found.fit, found.psf
    residual, origin = _residual_picture(fit)
    m = len(fit.observation.y)
    pixels = CELLS / BLOCK * block_size_px(fit.registration)
    return PatternPsf(
        psf=psf,
        n=m,
        quality=quality,
        diffraction=diffraction,
        gamma=gamma_of_fit(fit.equations, GEOMETRY, fit.observation.weight),
        gamma_bound=gamma_bound(m, psf.k**2),
        residual_std=fit.residual_std,
        pixels_per_pattern=pixels,
        s_over_t=d.s_over_t,
        choice=tried,
        variations=parts.variations,
        registration=fit.registration,
        centre_covariance=found.centre_covariance,
        diagnostics=asdict(d),
        marks=corners,
        residual=residual,
        residual_origin=origin,
        correspondences=correspondences(fit),
        shared=found.shared,
    )


def _residual_picture(fit: ChartFit) -> tuple[Array, tuple[int, int]]:
    """The residual where its samples lie, NaN between them, and the pixel (x, y) at which that picture begins."""
    o = fit.observation
    picture = np.full((o.rows.max() + 1, o.columns.max() + 1), np.nan)
    picture[o.rows, o.columns] = fit.residual
    x, y = o.points[0]
    return picture, (int(x) - int(o.columns[0]), int(y) - int(o.rows[0]))
