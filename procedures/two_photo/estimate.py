"""PSF from two photographs of one textured wall at different distances, with its uncertainty, or a refusal.

Source: Delbracio, Almansa, Muse, IPOL 2013, section 4; Delbracio's thesis, chapter 3 and appendix A.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.choice import Trial, choose, remaining_change, with_modes, with_parts
from procedures.corruption import directions, probability
from procedures.corruption.directions import ADAPTIVE, BORDER, GHOST
from procedures.corruption.evidence import TextureEvidence
from procedures.corruption.family import SampleGroup, strengths
from procedures.corruption.noise import (
    DRIFT,
    MASK_RADII,
    SMOOTHING_RADII,
    TEXTURES,
    Variogram,
    mask_scores,
    texture_correlation,
)
from procedures.display import html, summary
from procedures.numbers import GAIN, MTF50_HORIZONTAL, NOISE, PROBABILITY, RESIDUAL_STD, SCALE
from procedures.numerics.arrays import Array, Array32
from procedures.numerics.normal_equations import cholesky_solve, solve_constrained
from procedures.numerics.warps import CubicWarp
from procedures.outcome import SYMPTOM, Check, Outcome, Quantity, Refused, Verdict, verdict_of
from procedures.psf import Psf, Sampling
from procedures.quality import Diffraction, Quality, assess, beyond_diffraction
from procedures.raw import Plane, PlaneLike, as_plane
from procedures.two_photo.diagnostics import diagnose
from procedures.two_photo.error_parts import error_parts, likely_errors, widened
from procedures.two_photo.inter_image import PairFit, fit_kernel, linear_system, tiles_of
from procedures.two_photo.near_noise import InterImageKernel, noise_at_most, without_near_noise
from procedures.two_photo.pair_consistency import pair_consistency
from procedures.two_photo.recursion import Recovered, psf_by_equation, psf_by_recursion
from procedures.two_photo.registration import PairSighting, register
from procedures.two_photo.trust import MAX_UNCERTAINTY, check_distance, check_light, checks_of, most_samples_per_pixel

if TYPE_CHECKING:
    from matplotlib.axes import Axes


START_S = 3  # first s that is tried: a finer grid needs detail that few walls have


@dataclass(frozen=True)
class TwoPhotoParameters(Sampling):
    """Sampling of the PSF and solver: see `Sampling`.

    The non-negative solution is the published algorithm's projection, in the metric of the covariance instead of
    sample by sample.
    """

    s: int | None = None
    k: int | None = None
    solver: str = "ls"
    at: tuple[float, ...] = ()


@dataclass(frozen=True)
class TwoPhotoPsf:
    """The calibrated PSF of one plane, from two photographs.

    psf : centred on its centroid under a Gaussian window: two photographs of a wall determine no other centre
    quality : MTF and numbers of the PSF, with their uncertainty budgets
    inter_image : (k, k), the kernel from the near to the far photograph inside its support, sum 1
    scale : (lambda_x, lambda_y), near pixels per far pixel along x and y
    swapped : whether the second photograph given is the near one
    gain : contrast of the far photograph over the near one's
    noise : standard deviation of a pixel's noise, on the scale from black to white
    residual_std : residual in units of the upper limit of the far photograph's noise
    choice : tried s and k; the last one is this
    warp : far pixels -> near pixels
    diagnostics : mapping of str to float
    probability : probability that MTF50 along rows lies within two stated uncertainties: see `corruption.probability`
    """

    psf: Psf
    quality: Quality
    inter_image: Array
    scale: tuple[float, float]
    swapped: bool
    gain: float
    noise: float
    residual_std: float
    choice: tuple[Trial, ...]
    warp: CubicWarp
    diagnostics: Mapping[str, float]
    probability: float = float("nan")

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
    def diffraction(self) -> None:
        """None: the caller knows the diffraction limit."""

    @property
    def charts(self) -> tuple[()]:
        """Empty: a wall shows no chart."""
        return ()

    @property
    def variations(self) -> tuple[()]:
        """Empty: parts of the wall are not reported separately."""
        return ()

    @property
    def values(self) -> dict[str, float | tuple[float, float]]:
        """The numbers without uncertainty."""
        return {
            SCALE: self.scale,
            GAIN: self.gain,
            NOISE: self.noise,
            RESIDUAL_STD: self.residual_std,
            **({PROBABILITY: self.probability} if np.isfinite(self.probability) else {}),
        }


def estimate_psf_of_pair(
    a: PlaneLike, b: PlaneLike, parameters: TwoPhotoParameters | None = None, diffraction: Diffraction | None = None
) -> Outcome[TwoPhotoPsf]:
    """The PSF of the plane's camera from two photographs of one wall, in any order.

    a, b : Plane, or (rows, columns) arrays, linear samples of the same plane, black 0, white 1
    parameters : TwoPhotoParameters, s and k that are not given are chosen
    diffraction : Diffraction, diffraction limit of this plane, for the Strehl ratio

    Returns
    -------
    Outcome[TwoPhotoPsf]
        A refused outcome has a reason and a remedy and no value; poor photographs raise nothing.
    """
    near_or_far, other, given = as_plane(a), as_plane(b), parameters or TwoPhotoParameters()

    def estimate() -> Outcome[TwoPhotoPsf]:
        solved = solve_pair(near_or_far, other, given, diffraction)
        return judged(solved.checks, solved.result, raw=near_or_far.raw and other.raw)

    return or_refused(estimate, given)


def judged(checks: Sequence[Check], result: TwoPhotoPsf, *, raw: bool) -> Outcome[TwoPhotoPsf]:
    """The result with its verdict, and the probability that it lies within two stated uncertainties."""
    known = result.quality.numbers.get(MTF50_HORIZONTAL)
    if known is not None:
        within = probability.within_two("wall", checks, known.uncertainty / known.value, raw=raw)
        result = replace(result, probability=within)
    return verdict_of(checks, result)


def or_refused(estimate: Callable[[], Outcome[TwoPhotoPsf]], parameters: TwoPhotoParameters) -> Outcome[TwoPhotoPsf]:
    """The outcome of an estimate, refused where the photographs determine no PSF."""
    try:
        return estimate()
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    except np.linalg.LinAlgError:
        return Outcome(
            None,
            Verdict.REFUSED,
            f"the wall's texture must determine the kernel's values at s = {parameters.s or 'auto'}, "
            f"k = {parameters.k or 'auto'}; it does not",
            "choose a rougher wall with detail of all sizes, expose longer, or lower s or k",
        )


@dataclass(frozen=True)
class _PairAttempt:
    """The joint fit at one s and k, the kernel corrected for the near photograph's noise, and the PSFs derived from it:
    unconstrained, and by the requested solver."""

    fit: PairFit
    kernel: InterImageKernel
    recovered: Recovered
    free: Psf
    psf: Psf


@dataclass(frozen=True)
class SolvedPair:
    """A pair's result with the parts of its uncertainty, and the checks of its verdict.

    free : unconstrained PSF, with the covariance of the photographs' noise, that of the sum included
    errors : mapping of str to (k^2 + q,), errors of the parameters, one standard uncertainty each
    scatter : variance of the numbers by the scatter of the tiles, over that by white noise
    modes : relative changes of the transfer function that are not excluded
    """

    result: TwoPhotoPsf
    checks: list[Check]
    free: Psf
    errors: Mapping[str, Array]
    scatter: Mapping[str, float]
    modes: Mapping[str, Array]


def solve_pair(
    a: Plane,
    b: Plane,
    parameters: TwoPhotoParameters,
    diffraction: Diffraction | None,
    sighting: PairSighting | None = None,
) -> SolvedPair:
    """The PSF of a pair. Raises Refused."""
    saturated = check_light(a.samples, b.samples)
    sighting = sighting or register(a.samples, b.samples)
    near, far = (b.samples, a.samples) if sighting.swapped else (a.samples, b.samples)
    check_distance(sighting.H_near_far, far.shape, parameters.s or 2)
    most_s = most_samples_per_pixel(sighting.H_near_far, far.shape)
    limit = noise_at_most(near)
    best, tried = _chosen(near, far, sighting, limit, parameters, most_s)
    fit, kernel, J = best.fit, best.kernel, best.fit.scale()
    consistency = pair_consistency(fit, best.free, near)
    errors = likely_errors(consistency, best.recovered, best.free, J)
    psf = widened(best.psf, errors)
    unconverged = remaining_change(tried)
    quality = assess(psf, n=len(fit.residual), diffraction=diffraction, at=parameters.at, unconverged=unconverged)
    parts = error_parts(fit, kernel, best.recovered, best.free, quality, errors)
    quality = with_parts(quality, parts.parts)
    evidence = examine(fit, far, (quality.frequencies, quality.mtf_radial))
    raw = a.raw and b.raw
    modes = evidence.modes(quality.frequencies, raw=raw)
    quality = with_modes(quality, psf, modes)
    check = psf_by_equation(kernel.total, psf.s, J)
    off = float(np.linalg.norm(best.recovered.h - check.h) / np.linalg.norm(check.h))
    diagnostics = diagnose(fit, kernel, psf, sighting, near, far, limit, off, saturated, consistency, parts)
    contradicted = beyond_diffraction(quality, diffraction)
    scale_x, scale_y = np.linalg.norm(J, axis=0)
    result = TwoPhotoPsf(
        psf=psf,
        quality=quality,
        inter_image=kernel.k.reshape(psf.k, psf.k) / kernel.k.sum(),
        scale=(float(scale_x), float(scale_y)),
        swapped=sighting.swapped,
        gain=kernel.gain,
        noise=kernel.noise,
        residual_std=diagnostics.residual_std,
        choice=tried,
        warp=fit.warp,
        diagnostics=asdict(diagnostics),
    )
    # what the pair shows by itself names the cause better
    symptoms = [replace(one, prior=SYMPTOM * one.prior) for one in evidence.checks(raw=raw)]
    checks = [*checks_of(diagnostics, parameters, tried, psf.s, contradicted, raw=raw), *symptoms]
    total = float(best.recovered.h.sum())
    covariance = best.recovered.covariance(kernel.covariance) / total**2
    free = Psf.of(best.recovered.parameters / total, covariance, psf.k, psf.s)
    return SolvedPair(result, checks, free, errors, parts.mismatch, modes)


def _chosen(
    near: Array32, far: Array32, sighting: PairSighting, limit: float, parameters: TwoPhotoParameters, most_s: int
) -> tuple[_PairAttempt, tuple[Trial, ...]]:
    """The result for the given or chosen s and k, and the trials. Raises Refused."""
    start: CubicWarp | None = None

    def attempt(s: int, k: int) -> _PairAttempt:
        nonlocal start
        fit = fit_kernel(near, far, sighting.H_near_far, s, k, start)
        start = fit.warp
        kernel = without_near_noise(fit, limit)
        recovered = psf_by_recursion(kernel.total, s, fit.scale())
        covariance = recovered.covariance(kernel.covariance)
        free, psf = (solved_psf(recovered.parameters, covariance, k, s, one) for one in ("ls", parameters.solver))
        return _PairAttempt(fit, kernel, recovered, free, psf)

    samples = min(int(np.prod(far.shape)), int(np.prod(near.shape) / most_s**2))

    def chosen_from(start_s: int) -> tuple[_PairAttempt, tuple[Trial, ...]]:
        return choose(attempt, lambda one: one.psf, samples, most_s, start_s=start_s, s=parameters.s, k=parameters.k)

    coarser = parameters.s is None and most_s > 2  # for a wall with little fine detail
    try:
        best, tried = chosen_from(START_S)
    except (Refused, np.linalg.LinAlgError):
        if not coarser:
            raise
        return chosen_from(2)
    noisy = best.psf.relative_uncertainty > MAX_UNCERTAINTY
    return chosen_from(2) if coarser and noisy else (best, tried)


def solved_psf(p: Array, covariance: Array, k: int, s: int, solver: str) -> Psf:
    """The PSF of sum 1 by a solver, from the unconstrained parameters (k^2 + q,).

    The covariance is that of the unconstrained solution; for "clip" and "nnls" it is an upper limit.
    """
    n = k * k
    if solver != "ls":
        information = cholesky_solve(covariance[:n, :n], np.eye(n))
        change = solve_constrained(information, information @ p[:n], solver) - p[:n]
        # the tail follows the samples by their covariance
        p = p + np.concatenate([change, covariance[n:, :n] @ (information @ change)])
    return Psf.of_unit_sum(p, covariance, k, s)


# --- Evidence of corruptions in the far photograph of a pair: scores by its residual ---

CONTRAST = 4.0  # standard deviations of a wall's light that count as the contrast of black and white


def examine(fit: PairFit, far: Array32, curve: tuple[Array, Array]) -> TextureEvidence:
    """Scores of a fit; `curve` are frequencies and MTF."""
    image = fit.as_image(fit.residual, np.nan)
    residual = Variogram.of(np.nan_to_num(image), np.isfinite(image))
    textures = [texture_correlation(*curve, exponent) for exponent in TEXTURES]
    (x, y), (rows, columns) = fit.near.corner, fit.near.shape
    middle, scale = float(np.mean(fit.samples.y)), CONTRAST * float(np.std(fit.samples.y))
    picture = np.array(far[y : y + rows, x : x + columns], dtype=np.float64)
    at = fit.samples.rows, fit.samples.columns
    picture[at] = fit.prediction
    padded = np.pad((picture - middle) / scale, BORDER, mode="edge")
    smoothed = directions.adaptive(padded)
    pictures = directions.filters(padded) | directions.wide_masks(padded) | {ADAPTIVE: smoothed}
    values = [one[BORDER:-BORDER, BORDER:-BORDER][at] for one in pictures.values()]
    ghost = directions.mirrored(far, (x, y), (rows, columns))
    values.append((ghost[at] - middle) / scale)
    shared, own = linear_system(fit)
    group = SampleGroup(shared, own, fit.residual / scale, tiles_of(fit))
    # the Gram matrix of the last step has the priors of the tail
    amounts = strengths([group], [np.stack(values, axis=1)], fit.equations.G, fit.variance**0.5 / scale)
    return TextureEvidence(
        mask_scores([residual], MASK_RADII),
        mask_scores([residual], SMOOTHING_RADII, [DRIFT, *textures]),
        dict(zip([*pictures, GHOST], amounts, strict=True)),
        framed=False,
        mosaic=residual.mosaic.score,
        smoothing=directions.gain_along(smoothed, padded, curve[0]),
    )
