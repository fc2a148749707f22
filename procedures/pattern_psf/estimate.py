"""PSF from one photograph of the noise chart: the whole estimation, with uncertainties and a verdict.

Source: Delbracio, Muse, Almansa, IPOL 2012, section 4; Delbracio's thesis, chapter 2 and appendix A.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.choice import FINEST, START_S, Trial, choose, remaining_change, with_modes, with_parts
from procedures.clipping import SensorModel
from procedures.corruption import probability
from procedures.corruption.paper import measure_noise
from procedures.display import html, summary
from procedures.numbers import (
    GAMMA,
    GAMMA_BOUND,
    MTF50_HORIZONTAL,
    MTF50_VERTICAL,
    PIXELS_PER_PATTERN,
    PROBABILITY,
    RESIDUAL_STD,
    S_OVER_T,
)
from procedures.numerics.arrays import Array, Array32
from procedures.numerics.kernel_tail import far_light
from procedures.outcome import BadParameter, Check, Outcome, Quantity, Refused, checked_type, verdict_of, with_refusal
from procedures.pattern import AIM_S_OVER_T, BLOCK, CELLS, GOOD_S_OVER_T, Chart
from procedures.pattern_psf.chart_finding.detection import ChartSighting, check_usable, find_chart
from procedures.pattern_psf.correspondences import Correspondences, correspondences
from procedures.pattern_psf.corruptions import corruption_checks, modes_of, print_prior
from procedures.pattern_psf.diagnostics import Diagnostics, diagnose
from procedures.pattern_psf.error_parts import CALIBRATED, GROUPS, ErrorParts, Variation, error_parts
from procedures.pattern_psf.evidence import examine
from procedures.pattern_psf.gamma import gamma_bound, gamma_of_fit
from procedures.pattern_psf.observation import Observation, count_inside, noise_window, observe, surroundings
from procedures.pattern_psf.outliers import (
    ExcludedSamples,
    excluded_samples,
    refit_iteratively,
    within_levels,
    without_hidden_places,
    without_outliers,
)
from procedures.pattern_psf.radiometry import LightLevels, bend_of_chart, measure_light, straighten, with_sensor
from procedures.pattern_psf.refine import GEOMETRY, ChartFit, TailPrior, fit_by_marks, refine
from procedures.pattern_psf.registration import (
    Registration,
    block_size_px,
    mark_residuals,
    refine_corners,
    register_marks,
)
from procedures.pattern_psf.solution import SharedErrors, Solution, solution
from procedures.pattern_psf.trust import (
    VerdictInputs,
    check_cells,
    check_light,
    checks_of,
    is_misfit,
    is_structured,
    refusal_checks,
)
from procedures.psf import Psf, Sampling
from procedures.psf_origin import Origin
from procedures.quality import PRINT_BLUR, Diffraction, Quality, assess, beyond_diffraction
from procedures.raw import Plane, PlaneLike, as_plane

if TYPE_CHECKING:
    from matplotlib.axes import Axes


CHECKED_NUMBERS = (MTF50_HORIZONTAL, MTF50_VERTICAL)  # numbers checked for variation over the chart
PUPIL_SPREAD = 0.1
"""Relative standard uncertainty of the far tail expected from f-number and pitch: spread of wavelengths, non-circular
or vignetted pupils, rounded f-numbers."""
SAMPLES_PER_CELL = 2.0  # largest s/t chosen automatically: there the cells' spectrum reaches zero at the band's edge
MAX_EXCLUSIONS = 10  # greatest number of fits that exclude hidden places
MIN_VISIBLE_SHARE = 0.5  # least share of the noise region's samples that remain when hidden places are excluded


@dataclass(frozen=True)
class PatternParameters(Sampling):
    """Sampling of the PSF and solver, see `Sampling`; k of 3 s + 1 to 6 s + 1 is usual.

    chosen : bool, whether given s and k were chosen from another photograph; they are not flagged as doubtful then
    origin : "marks", "centroid" or "peak"
        The point about which widths, encircled energies and the Strehl ratio are taken.
    print_blur : float, standard deviation of the print's blur in cells. None: by the printer's dots where the
        photograph shows them, otherwise `corruptions.PRINT_UNKNOWN`.
    """

    s: int | None = None
    k: int | None = None
    solver: str = "ls"
    at: tuple[float, ...] = ()
    chosen: bool = False
    origin: Origin = "marks"
    print_blur: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.print_blur is not None and not 0 <= self.print_blur <= 1:
            raise BadParameter(
                f"the print's blur must be 0 to 1 cells; got {self.print_blur:g}",
                "give the standard deviation of its blur over the side of a cell",
            )

    def to_record(self) -> dict[str, int | float | str | list[float]]:
        """Entries of a record."""
        known = {} if self.print_blur is None else {"print_blur": self.print_blur}
        return {**super().to_record(), **known}


@dataclass(frozen=True)
class PatternPsf:
    """PSF of one plane at one position in the frame.

    n : number of samples
    quality : MTF and the sharpness metrics derived from the PSF, with their uncertainty budgets
    diffraction : diffraction limit of the plane, where known
    gamma, gamma_bound : noise amplification sum 1 / sigma_i^2 of the photograph, and its lower bound over all charts:
        see `pattern_psf.gamma`
    residual_std : residual in units of the noise measured on the blocks
    pixels_per_pattern : width of the noise region in pixels of the plane
    s_over_t : sampling ratio; 1 is ideal
    choice : trials of s and k; the last one gave this PSF
    variations : MTF50 in the halves of the chart
    centre_covariance : (2, 2) image (x, y) of a mark at the chart's centre, in pixels of the plane: its position by the
        registration plus the `mark_offset` of the PSF, which the last step reduces to its noise
    marks : (12, 2) detected x-corners, (x, y) in pixels, NaN where hidden
    residual : (rows, columns) photograph minus prediction in units of the noise, over the noise region; NaN where no
        sample was used
    residual_origin : first pixel (x, y) of `residual` in the plane
    correspondences : positions of parts of the chart, each measured by its own cells: the input of geometric
        calibration
    shared : covariances of PSF, centre and these positions
    modes : relative changes of the transfer function, at `quality.frequencies`, by corruptions that are not excluded
    probability : probability that MTF50 along rows lies within two stated uncertainties: see `corruption.probability`
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
    probability: float = float("nan")
    modes: Mapping[str, Array] = field(default_factory=dict)

    __repr__ = summary
    _repr_html_ = html

    @property
    def numbers(self) -> Mapping[str, Quantity]:
        """The numbers of `quality`."""
        return self.quality.numbers

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the MTF; `psf.plot` draws the PSF."""
        return self.quality.plot(ax)

    @property
    def charts(self) -> tuple[PatternPsf, ...]:
        """Estimates from single photographs: this one."""
        return (self,)

    @property
    def inter_image(self) -> None:
        """None: the inter-image PSF needs two photographs."""

    @property
    def values(self) -> dict[str, float]:
        """Numbers without an uncertainty."""
        return {
            GAMMA: self.gamma,
            GAMMA_BOUND: self.gamma_bound,
            RESIDUAL_STD: self.residual_std,
            PIXELS_PER_PATTERN: self.pixels_per_pattern,
            S_OVER_T: self.s_over_t,
            **({PROBABILITY: self.probability} if np.isfinite(self.probability) else {}),
        }


@with_refusal
def estimate_psf(
    plane: PlaneLike,
    chart: Chart,
    parameters: PatternParameters | None = None,
    diffraction: Diffraction | None = None,
    sighting: ChartSighting | None = None,
    sensor: SensorModel | None = None,
) -> Outcome[PatternPsf]:
    """Estimate the PSF of a plane that shows the chart.

    plane : Plane, or (rows, columns) array, linear samples, black 0, white 1; the chart may lie anywhere
    chart : Chart, the printed cells
    diffraction : Diffraction, diffraction limit of this plane; with it the Strehl ratio is reported too
    sighting : ChartSighting, optional
        The chart to use, of several in the photograph (`detection.find_charts`); None: the only one is detected.
    sensor : SensorModel, optional
        Calibration of the sensor: its response is inverted instead of fitted, its noise weights the samples.

    Returns
    -------
    Outcome[PatternPsf]
        A refused outcome has a reason and a remedy and no value; poor photographs raise nothing.
    """
    plane, parameters = as_plane(plane), parameters or PatternParameters()
    checked_type(chart, Chart, "pass Chart.from_seed() for the chart of `station pattern`")
    plane = plane if sensor is None else straighten(plane, sensor)
    samples, solved = plane.samples, _solve(plane, chart, parameters, sighting, diffraction, sensor)
    final, tried, light, corners = solved.final, solved.tried, solved.light, solved.corners
    psf = final.solution.psf
    unconverged = remaining_change(tried)
    quality = assess(
        psf, n=len(final.fit.observation), diffraction=diffraction, at=parameters.at, unconverged=unconverged,
        origin=parameters.origin,
    )  # fmt: skip
    parts = error_parts(final.fit, psf, quality, CHECKED_NUMBERS, GROUPS if sensor is None else CALIBRATED)
    quality = with_parts(quality, parts.parts)
    around = surroundings(final.fit.registration, samples.shape).cut(samples)
    levels = float(light.black[0]), float(light.white[0])
    noise = measure_noise(around, levels, light.variance_at, final.fit.residual_image)
    curve = quality.frequencies, quality.mtf_radial
    evidence = examine(final.fit, samples, light, chart, psf.s, psf.k, (noise.paper, noise.residual), curve)
    narrow = solved.narrow.solution.psf
    diagnostics = diagnose(
        final.fit, psf, narrow, light, corners, solved.marks_map, final.excluded, parts, solved.tail, tried[-1], noise,
        evidence.fine,
    )  # fmt: skip
    print_blur = print_prior(final.fit.edges) if parameters.print_blur is None else parameters.print_blur
    modes = modes_of(evidence, quality.frequencies, final.fit.registration, print_blur, raw=plane.raw)
    quality = with_modes(quality, psf, modes)
    contradicted = beyond_diffraction(quality, diffraction)
    inputs = VerdictInputs(parameters, parameters.chosen, tried, parts.variations, contradicted, sensor, plane.raw)
    structured = is_structured(diagnostics)
    corrupted = corruption_checks(evidence, tried[-1], diagnostics.s_over_t, raw=plane.raw, structured=structured)
    checks = [*solved.refusals, *checks_of(diagnostics, final.fit, inputs), *corrupted]
    result = _result(final, quality, parts, tried, diagnostics, corners, diffraction)
    return verdict_of(checks, replace(result, modes=modes, probability=_probability(checks, quality, raw=plane.raw)))


@with_refusal
def locate_bins(
    plane: Plane, chart: Chart, parameters: PatternParameters, sighting: ChartSighting
) -> Outcome[tuple[Registration, Correspondences]]:
    """The map and the bins of a chart without its PSF, unless this would be refused; see `estimate_psf`."""
    solved = _solve(plane, chart, parameters, sighting)
    fit = solved.final.fit
    return verdict_of(solved.refusals, (fit.registration, correspondences(fit)))


def finest(cell_px: float, most: float = SAMPLES_PER_CELL) -> int:
    """Largest s with at most `most` samples per cell, for cells of a side in pixels."""
    return int(np.clip(np.floor(most / cell_px + 1e-9), 2, FINEST))


@dataclass(frozen=True)
class _Solved:
    """The joint fit at the chosen s and k, the trials, what it began with, and the checks that refuse it.

    narrow : the fit of the narrowest support, with this s, that is wide enough for the tail: a wider one absorbs what
        a wide mask changed
    """

    final: _Attempt
    narrow: _Attempt
    tried: tuple[Trial, ...]
    light: LightLevels
    corners: Array
    marks_map: Registration
    tail: TailPrior | None
    refusals: list[Check]


def _solve(
    plane: Plane,
    chart: Chart,
    parameters: PatternParameters,
    sighting: ChartSighting | None,
    diffraction: Diffraction | None = None,
    sensor: SensorModel | None = None,
) -> _Solved:
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
    attempts: dict[tuple[int, int], _Attempt] = {}

    def attempt(s: int, k: int) -> _Attempt:
        nonlocal best
        fit, excluded = _fit(samples, chart, corners, best, light, s, k, known)
        check_cells(fit)
        if fit.converged:
            best = fit.registration
        attempts[s, k] = _Attempt(fit, excluded, solution(fit, s, k, parameters.solver))
        return attempts[s, k]

    cell_px = block_size_px(marks_map) / BLOCK
    count = count_inside(marks_map, noise_window(marks_map, samples.shape))
    first_s = min(START_S, finest(cell_px, GOOD_S_OVER_T[1]))
    s, k = parameters.s, parameters.k
    try:
        final, tried = choose(attempt, lambda one: one.solution.psf, count, finest(cell_px), start_s=first_s, s=s, k=k)
    except np.linalg.LinAlgError as error:
        raise Refused(
            f"the photograph does not determine the PSF at s = {s or 'auto'}, k = {k or 'auto'}",
            f"photograph the chart from a distance where s/t is near {AIM_S_OVER_T:g}, or lower s or k",
        ) from error
    refusals = refusal_checks(final.fit, final.solution.psf, light, corners, raw=plane.raw)
    enough = (trial for trial in tried if trial.s == tried[-1].s and not trial.support_short)
    narrow = next((attempts[trial.s, trial.k] for trial in enough), final)
    return _Solved(final, narrow, tried, light, corners, marks_map, known.tail, refusals)


def _probability(checks: Sequence[Check], quality: Quality, *, raw: bool) -> float:
    """Probability that MTF50 along rows lies within two stated uncertainties; NaN where it is not known."""
    known = quality.numbers.get(MTF50_HORIZONTAL)
    if known is None:
        return float("nan")
    printed = quality.budgets[MTF50_HORIZONTAL].get(PRINT_BLUR, 0.0) / known.value
    return probability.within_two("chart", checks, known.uncertainty / known.value, raw=raw, printed=printed)


@dataclass(frozen=True)
class _Known:
    """Prior knowledge of the fit: the far tail, by diffraction; beta's uncertainty, by the sensor's calibration."""

    tail: TailPrior | None
    bend: float | None


@dataclass(frozen=True)
class _Attempt:
    """Joint fit at one s and k, the samples excluded from it, and its solution."""

    fit: ChartFit
    excluded: ExcludedSamples
    solution: Solution


def _register(samples: Array32, sighting: ChartSighting | None) -> tuple[Array, Registration]:
    """Subpixel positions of the chart's marks, and the map fitted to them."""
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
            f"the chart's marks must lie in one plane; one is {worst:.1f} px off",
            "flatten the chart, and keep its marks free of reflections and shadows",
        )
    return corners, registration


def _fit(
    samples: Array32,
    chart: Chart,
    corners: Array,
    registration: Registration,
    light: LightLevels,
    s: int,
    k: int,
    known: _Known,
) -> tuple[ChartFit, ExcludedSamples]:
    """Joint fit, and the samples excluded from it as outliers."""
    window = noise_window(registration, samples.shape)
    hidden = not np.isfinite(corners).all()
    whole = observe(samples, registration, light, window, margin_px=k / (2 * s) if hidden else 0.0)
    observation = within_levels(whole)
    m, n = len(whole), k * k
    if m < 2 * n:
        raise Refused(
            f"{n} PSF values require at least {2 * n} samples of the noise region; the photograph has {m}",
            "move closer, or lower k",
        )
    levels = float(light.black[0]), float(light.white[0])
    far = far_light(samples, (window.x, window.y), (window.rows, window.columns), s, k, levels)

    def fitted(samples_used: Observation) -> ChartFit:
        return refine(samples_used, chart, registration, window, s, k, far, known.tail, known.bend)

    def fit_marks_map(samples_used: Observation) -> ChartFit:
        return fit_by_marks(samples_used, chart, registration, window, s, k)

    fit = refit_iteratively(fitted(observation), fitted, without_outliers, 2 * n)
    if is_misfit(fit):  # where the chart is partly hidden, the rest may suffice
        clear = refit_iteratively(
            fit_marks_map(observation), fit_marks_map, without_hidden_places, 2 * n, MAX_EXCLUSIONS
        )
        clear = refit_iteratively(fitted(clear.observation), fitted, without_hidden_places, 2 * n)
        clear = refit_iteratively(clear, fitted, without_outliers, 2 * n)
        fit = fit if is_misfit(clear) or len(clear.observation) < MIN_VISIBLE_SHARE * m else clear
    return fit, excluded_samples(whole, fit.observation)


def _result(
    final: _Attempt,
    quality: Quality,
    parts: ErrorParts,
    tried: tuple[Trial, ...],
    d: Diagnostics,
    corners: Array,
    diffraction: Diffraction | None,
) -> PatternPsf:
    fit, psf, o = final.fit, final.solution.psf, final.fit.observation
    return PatternPsf(
        psf=psf,
        n=len(o),
        quality=quality,
        diffraction=diffraction,
        gamma=gamma_of_fit(fit.equations, GEOMETRY, o.weight),
        gamma_bound=gamma_bound(len(o), psf.k**2),
        residual_std=fit.residual_std,
        pixels_per_pattern=CELLS / BLOCK * block_size_px(fit.registration),
        s_over_t=d.s_over_t,
        choice=tried,
        variations=parts.variations,
        registration=fit.registration,
        centre_covariance=final.solution.centre_covariance,
        diagnostics=asdict(d),
        marks=corners,
        residual=fit.residual_image,
        residual_origin=(o.window.x, o.window.y),
        correspondences=correspondences(fit),
        shared=final.solution.shared,
    )
