"""The PSF that is reported, of sum 1 and by the solver asked for, with its covariance and its centre's."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_prior import prior_covariance
from procedures.numerics.solvers import cholesky_inverse, solve_constrained
from procedures.pattern import CELLS
from procedures.pattern_psf.centre import mark_offset_gradient
from procedures.pattern_psf.refine import GEOMETRY, TAIL, ChartFit
from procedures.psf import Psf, PsfTail

Array = npt.NDArray[np.float64]


def solution(fit: ChartFit, s: int, k: int, solver: str) -> tuple[Psf, Array]:
    """The PSF as asked for, of sum 1, with the covariance of the least-squares solution, and of its centre (2, 2).

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
    centre_covariance = _centre_covariance(fit, covariance[:n, :n], forth)
    covariance = covariance + back @ (forth @ covariance[:n])
    covariance = covariance + (covariance[:, :n] @ forth.T) @ back.T
    tail = PsfTail(p[n:], covariance[n:, n:], covariance[:n, n:])
    return Psf(image, s, covariance[:n, :n], tail), centre_covariance


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


def _centre_covariance(fit: ChartFit, covariance: Array, forth: Array) -> Array:
    """Covariance (2, 2), in squared pixels, of the place where the chart's centre is seen.

    An error of h moves where the marks are seen, by `forth`, and brings errors of the displacement with it; the
    displacement's own come on top. Those count from the samples' mean, which stays in place, to the chart's centre.
    """
    o, equations = fit.observation, fit.equations
    middle = fit.registration.to_sensor(np.full((1, 2), CELLS / 2))
    monomials = fit.registration.monomials(middle)[0] - o.cubics.mean(axis=0)
    displaced = np.kron(np.eye(2), monomials)
    with_h = equations.E[:GEOMETRY] * fit.h.sum()
    own = cholesky_inverse(equations.ZZ)[:GEOMETRY, :GEOMETRY] * fit.residual_std**2
    moved = forth + displaced @ with_h
    return np.asarray(moved @ covariance @ moved.T + displaced @ own @ displaced.T)
