"""PSF from photographs of one wall at any number of distances: one solution, one covariance.

The nearest photograph and each of the others make a pair, with its own focus, light and map. Every pair's kernel
determines the same PSF up to noise, and to first order the PSF that fits all kernels in the metric of their covariances
is the mean of the pairs' PSFs weighted by the inverses of these. The noise of the far photographs is independent; that
of the near one, which all pairs share, is neglected, which is half a per cent of the uncertainty.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg

from procedures.choice import remaining_change, with_modes, with_parts
from procedures.numbers import MTF_CROSSINGS
from procedures.numerics.arrays import Array
from procedures.numerics.warps import homography_jacobian
from procedures.outcome import BadParameter, Check, Outcome, Verdict
from procedures.psf import Psf
from procedures.quality import Diffraction, Quality, assess, beyond_diffraction
from procedures.raw import Plane, PlaneLike, as_plane
from procedures.two_photo.error_parts import widened
from procedures.two_photo.estimate import (
    SolvedPair,
    TwoPhotoParameters,
    TwoPhotoPsf,
    estimate_psf_of_pair,
    judged,
    or_refused,
    solve_pair,
    solved_psf,
)
from procedures.two_photo.registration import PairSighting, register

RIDGE = 0.1
"""Variance added in the weights, relative to the mean variance of the samples: model errors have no small variances."""
DISAGREEMENT = 4.0  # standard uncertainties of their difference by which a pair's MTF50 may differ from that of all


def estimate_psf_of_wall(
    photographs: Sequence[PlaneLike],
    parameters: TwoPhotoParameters | None = None,
    diffraction: Diffraction | None = None,
) -> Outcome[TwoPhotoPsf]:
    """The PSF of the plane's camera from two or more photographs of one wall at different distances, in any order.

    photographs : sequence of Plane, or of (rows, columns) arrays, linear samples of the same plane, black 0, white 1
    parameters : TwoPhotoParameters, s and k that are not given are chosen by the far photograph nearest to the wall
    diffraction : Diffraction, diffraction limit of this plane, for the Strehl ratio

    Returns
    -------
    Outcome[TwoPhotoPsf]
        Kernel, scale, gain and noise are those of the pair whose far photograph is nearest.

    Raises BadParameter if there are fewer than two photographs.
    """
    planes, given = [as_plane(photograph) for photograph in photographs], parameters or TwoPhotoParameters()
    if len(planes) < 2:
        raise BadParameter(f"a wall needs two photographs or more; got {len(planes)}", "add one from farther away")
    if len(planes) == 2:
        return estimate_psf_of_pair(planes[0], planes[1], given, diffraction)
    raw = all(plane.raw for plane in planes)
    return or_refused(lambda: _joined(_pairs(planes, given, diffraction), given, diffraction, raw=raw), given)


_WallPair = tuple[int, SolvedPair]
"""The number of a pair's far photograph, counted from 1, and its solution."""


def _pairs(planes: list[Plane], parameters: TwoPhotoParameters, diffraction: Diffraction | None) -> list[_WallPair]:
    """The nearest photograph with each of the others, in the order of their distances. Raises Refused."""
    sightings = [register(planes[0].samples, plane.samples) for plane in planes[1:]]
    distances = [1.0, *(_times_as_far(one) for one in sightings)]
    order = np.argsort(distances)
    near, others = int(order[0]), [int(i) for i in order[1:]]
    pairs: list[_WallPair] = []
    for i in others:
        sighting = sightings[i - 1] if near == 0 else None
        solved = solve_pair(planes[near], planes[i], parameters, diffraction, sighting)
        pairs.append((i + 1, solved))
        parameters = replace(parameters, s=solved.result.psf.s, k=solved.result.psf.k)
    return pairs


def _times_as_far(sighting: PairSighting) -> float:
    """Distance of the second photograph over that of the first."""
    zoom = float(np.sqrt(abs(np.linalg.det(homography_jacobian(sighting.H_near_far, np.zeros(2))))))
    return 1 / zoom if sighting.swapped else zoom


def _joined(
    pairs: list[_WallPair], parameters: TwoPhotoParameters, diffraction: Diffraction | None, *, raw: bool
) -> Outcome[TwoPhotoPsf]:
    solved = [pair for _, pair in pairs]
    first = solved[0].result
    gains = weights([one.free for one in solved])
    free = joined_psf([one.free for one in solved], gains, "ls")
    errors = {
        term: np.sum([gain @ one.errors[term] for gain, one in zip(gains, solved, strict=True)], axis=0)
        for term in solved[0].errors
    }
    psf = widened(joined_psf([one.free for one in solved], gains, parameters.solver), errors)
    n = sum(next(iter(one.result.quality.numbers.values())).n for one in solved)
    unconverged = remaining_change(first.choice)
    quality = assess(psf, n=n, diffraction=diffraction, at=parameters.at, unconverged=unconverged)
    quality = with_parts(quality, _parts(quality, free, errors, solved))
    modes = {term: np.mean([one.modes[term] for one in solved], axis=0) for term in solved[0].modes}
    quality = with_modes(quality, psf, modes)
    diagnostics = {**first.diagnostics, "photographs": len(pairs) + 1}
    result = replace(first, psf=psf, quality=quality, diagnostics=diagnostics)
    checks = [
        replace(check, sentence=f"photograph {number}: {check.sentence}")
        for number, pair in pairs
        for check in pair.checks
    ]
    checks += [_agreement(pairs, quality), *beyond_diffraction(quality, diffraction)]
    return judged(checks, result, raw=raw)


def weights(estimates: Sequence[Psf]) -> list[Array]:
    """Matrices (k^2 + q, k^2 + q) of sum I by which the parameters of the estimates are weighted."""
    inverses = [scipy.linalg.inv(_with_ridge(estimate)) for estimate in estimates]
    whole = scipy.linalg.inv(np.sum(inverses, axis=0))
    return [np.asarray(whole @ inverse) for inverse in inverses]


def _with_ridge(psf: Psf) -> Array:
    covariance = psf.parameter_covariance
    variances = np.diag(covariance)
    ridge = np.concatenate([np.full(psf.k**2, variances[: psf.k**2].mean()), variances[psf.k**2 :]])
    return np.asarray(covariance + np.diag(RIDGE * ridge))


def joined_psf(estimates: Sequence[Psf], gains: Sequence[Array], solver: str) -> Psf:
    """The weighted mean of the estimates, of sum 1, by a solver."""
    pairs = list(zip(gains, estimates, strict=True))
    p = np.sum([gain @ one.parameters for gain, one in pairs], axis=0)
    covariance = np.sum([gain @ one.parameter_covariance @ gain.T for gain, one in pairs], axis=0)
    return solved_psf(p, covariance, estimates[0].k, estimates[0].s, solver)


def _parts(
    quality: Quality, free: Psf, errors: dict[str, Array], solved: Sequence[SolvedPair]
) -> dict[str, dict[str, float]]:
    """Budget of every number; the tiles' scatter is the largest of the pairs."""
    parts = {}
    for name, gradient in quality.gradients.items():
        noise = max(float(gradient @ free.parameter_covariance @ gradient), 0.0) ** 0.5
        scatter: float = max(one.scatter.get(name, 1.0) for one in solved)
        moved = {term: float(gradient @ error) for term, error in errors.items()}
        parts[name] = {
            "noise": noise,
            "mismatch": math.hypot(noise * max(scatter - 1, 0.0) ** 0.5, moved["mismatch"]),
            "light": abs(moved["light"]),
            "focus": math.hypot(moved["focus"], moved["sharpening"]),
        }
    return parts


def _agreement(pairs: Sequence[_WallPair], whole: Quality) -> Check:
    """Pairs whose MTF50 differs from that of all by more than their uncertainties."""
    off = [_disagreement(pair.result.quality, whole) for _, pair in pairs]
    number, _ = pairs[int(np.argmax(off))]
    return Check(
        "other distances", max(off), DISAGREEMENT, Verdict.DOUBTFUL,
        f"the distances disagree by {max(off):.1f} standard uncertainties, most of all photograph {number}",
        "focus again at every distance, take all in the same light, or use fewer photographs",
    )  # fmt: skip


def _disagreement(pair: Quality, whole: Quality) -> float:
    """Largest difference of MTF50 in standard uncertainties; of a part and a mean, variances are subtracted."""
    off = [0.0]
    for name in MTF_CROSSINGS.values():
        if name in pair.numbers and name in whole.numbers:
            one, other = pair.numbers[name], whole.numbers[name]
            spread = max(one.uncertainty**2 - other.uncertainty**2, 0.25 * one.uncertainty**2, 1e-18)
            off.append(abs(one.value - other.value) / spread**0.5)
    return max(off)
