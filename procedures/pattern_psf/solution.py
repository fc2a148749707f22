"""The PSF that is reported, of sum 1 and by the solver asked for, with its covariance and its centre's.

Its errors, its centre's and those of the chart's bins come from the same samples. The joint fit has errors of the PSF,
h, and of the displacement, g: g = -E h + w, w what the noise adds to it where h is known. The chart's centre is seen
where the map and the PSF's own mark put it, c = F h - D g. A bin is placed by its own samples (`correspondences`), with
r = n - A h - J g - ...: map and step of the bin together have no g in them, only the noise n, h, and F h, by which the
marks hold the whole map. The covariance of n with the fit's errors is that of the fit's part of it, so that

    Cov(x, p) = Cov(F h - D_x g, p)

for the place x of a bin and any p that comes from the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_prior import prior_covariance
from procedures.numerics.solvers import cholesky_inverse, solve_constrained
from procedures.pattern import CELLS
from procedures.pattern_psf.centre import mark_offset_gradient
from procedures.pattern_psf.refine import GEOMETRY, TAIL, ChartFit
from procedures.pattern_psf.registration import Registration
from procedures.psf import Psf, PsfTail

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Covariances of a chart's parts, P the number of the PSF's parameters.

    Attributes
    ----------
    centre : (P, 2) float64
        Of the PSF's parameters with the place where the chart's centre is seen, in pixels of the plane.
    displacement : (18, P + 2) float64
        Of the coefficients of the map's displacement with the PSF's parameters, then with that place.
    mark : (2, P + 2) float64
        Of the place of the PSF's mark with the same.
    middle : (9,) float64
        Mean of the displacement's monomials over the samples: where the map stays in place.
    """

    centre: Array
    displacement: Array
    mark: Array
    middle: Array

    def of_points(self, registration: Registration, points: Array) -> Array:
        """Covariance (n, 2, P + 2) of places (n, 2), as bins are seen there, with the PSF's parameters and centre."""
        monomials = registration.monomials(points) - self.middle
        halves = self.displacement.reshape(2, 9, -1)
        return np.asarray(self.mark - np.einsum("nm,amp->nap", monomials, halves))


@dataclass(frozen=True, eq=False)
class Solution:
    """The PSF, the covariance (2, 2) of where the chart's centre is seen, and what both share with the map."""

    psf: Psf
    centre_covariance: Array
    shared: SharedErrors


def solution(fit: ChartFit, s: int, k: int, solver: str) -> Solution:
    """The PSF as asked for, of sum 1, with the covariance of the least-squares solution.

    For "clip" and "nnls" the same covariance is an upper limit: what they add to the data only takes noise away.
    """
    covariance = _with_tail(fit)
    h = _kernel(fit, covariance[: k * k, : k * k], s, solver)
    amplitudes = fit.light[TAIL:] + fit.equations.response(h - fit.h)[GEOMETRY + TAIL :]
    p, covariance = _normalised(np.concatenate([h, amplitudes]), covariance, len(h))
    # the centre follows the PSF: an error of h that shifts it shifts the map back
    n, image = len(h), p[: len(h)].reshape(k, k)
    slope_y, slope_x = np.gradient(image)
    back = np.zeros((len(p), 2))
    back[:n] = np.column_stack([slope_x.ravel(), slope_y.ravel()]) * s
    forth = mark_offset_gradient(image, s, fit.registration.jacobian())
    displaced = _displaced(fit)
    shared = _following(_shared(fit, covariance, forth, displaced), forth, back)
    centre_covariance = _centre_covariance(fit, covariance[:n, :n], forth, displaced)
    covariance = covariance + back @ (forth @ covariance[:n])
    covariance = covariance + (covariance[:, :n] @ forth.T) @ back.T
    tail = PsfTail(p[n:], covariance[n:, n:], covariance[:n, n:])
    return Solution(Psf(image, s, covariance[:n, :n], tail), centre_covariance, shared)


def _kernel(fit: ChartFit, covariance: Array, s: int, solver: str) -> Array:
    """The kernel (k^2,) as the solver has it, its sum the contrast's correction.

    Non-negativity alone leaves the noise that is positive: where a photograph is noisy that is most of the
    error. How large, wide and smooth the kernel is shows above that noise, and holds the rest of it down.
    """
    if solver == "ls":
        return fit.h
    G = fit.equations.G / fit.residual_std**2
    b = G @ fit.h
    if solver == "nnls":
        G = G + cholesky_inverse(prior_covariance(fit.h, covariance, s))
    return solve_constrained(G, b, solver)


def _with_tail(fit: ChartFit) -> Array:
    """Covariance of the samples and the tail's amplitudes, (k^2 + q, k^2 + q), before they are normalised.

    Given h, the nuisance parameters are linear in it: t = (Z'Z)^-1 (Z'r - Z'A h).
    """
    equations = fit.equations
    of_tail = slice(GEOMETRY + TAIL, None)
    C, E = equations.inverse, equations.E[of_tail]
    cross = -C @ E.T
    own = cholesky_inverse(equations.ZZ)[of_tail, of_tail] - E @ cross
    return np.block([[C, cross], [cross.T, own]]) * fit.residual_std**2


def _normalised(p: Array, covariance: Array, n: int) -> tuple[Array, Array]:
    """Parameters over the sum of the first n of them, the samples, and their covariance, to first order."""
    total = p[:n].sum()
    p = p / total
    # J C J' with J = (I - p 1_n') / total
    covariance = covariance - np.outer(p, covariance[:n].sum(axis=0))
    covariance = covariance - np.outer(covariance[:, :n].sum(axis=1), p)
    return p, covariance / total**2


def _displaced(fit: ChartFit) -> Array:
    """How the displacement's coefficients move the chart's centre, (2, 18), from the samples' mean, which stays."""
    middle = fit.registration.to_sensor(np.full((1, 2), CELLS / 2))
    return np.kron(np.eye(2), fit.registration.monomials(middle)[0] - fit.observation.cubics.mean(axis=0))


def _shared(fit: ChartFit, covariance: Array, forth: Array, displaced: Array) -> SharedErrors:
    """What the map's displacement shares with a PSF of sum 1 of that covariance, and with its centre."""
    own = cholesky_inverse(fit.equations.ZZ)[:GEOMETRY] * fit.residual_std**2
    kept = np.hstack([own[:, :GEOMETRY], own[:, GEOMETRY + TAIL :]])
    middle, total = fit.observation.cubics.mean(axis=0), float(fit.h.sum())
    return _shared_errors(kept, fit.equations.E[:GEOMETRY] * total, covariance, forth, displaced, middle, total)


def _centre_covariance(fit: ChartFit, covariance: Array, forth: Array, displaced: Array) -> Array:
    """Covariance (2, 2), in squared pixels, of the place where the chart's centre is seen.

    An error of h moves where the marks are seen, by `forth`, and brings errors of the displacement with it; the
    displacement's own come on top.
    """
    equations = fit.equations
    with_h = equations.E[:GEOMETRY] * fit.h.sum()
    own = cholesky_inverse(equations.ZZ)[:GEOMETRY, :GEOMETRY] * fit.residual_std**2
    moved = forth + displaced @ with_h
    return np.asarray(moved @ covariance @ moved.T + displaced @ own @ displaced.T)


# --- what errors share ----------------------------------------------------------------------------------------------


def _shared_errors(
    own: Array, with_h: Array, covariance: Array, forth: Array, displaced: Array, middle: Array, total: float
) -> SharedErrors:
    """The covariances, before the PSF's samples follow their centre (`_following`).

    Parameters
    ----------
    own : (18, 18 + q) float64
        Covariance of the displacement's coefficients with themselves and the tail's amplitudes, h known.
    with_h : (18, n) float64
        By what the displacement falls as a PSF of sum 1 grows: E.
    covariance : (P, P) float64
        Of the PSF's parameters, of sum 1.
    forth : (2, n) float64
        How the mark's place follows the PSF: F.
    displaced : (2, 18) float64
        How the chart's centre follows the displacement: D.
    middle : (9,) float64
    total : float
        Sum of the PSF's samples before they were normalised.
    """
    n = with_h.shape[1]
    of_parameters = -with_h @ covariance[:n]
    of_parameters[:, n:] += own[:, 18:] / total
    itself = with_h @ covariance[:n, :n] @ with_h.T + own[:, :18]
    of_centre = of_parameters[:, :n] @ forth.T - itself @ displaced.T
    centre = covariance[:, :n] @ forth.T - of_parameters.T @ displaced.T
    mark = np.hstack([forth @ covariance[:n], forth @ centre[:n]])
    return SharedErrors(centre, np.hstack([of_parameters, of_centre]), mark, middle)


def _following(shared: SharedErrors, forth: Array, back: Array) -> SharedErrors:
    """The same where the PSF's samples have followed their centre: h + back forth h."""
    n = forth.shape[1]

    def followed(of_parameters: Array) -> Array:
        return np.asarray(of_parameters + (of_parameters[:, :n] @ forth.T) @ back.T)

    displacement, mark = (np.hstack([followed(one[:, :-2]), one[:, -2:]]) for one in (shared.displacement, shared.mark))
    return SharedErrors(followed(shared.centre.T).T, displacement, mark, shared.middle)
