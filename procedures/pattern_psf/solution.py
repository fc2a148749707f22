"""Reported PSF, of sum 1 and by the requested solver, with its covariance and that of its centre.

The errors of the PSF, of its centre and of the chart's bins come from the same samples. The joint fit has the errors h
of the PSF and g of the displacement, g = -E h + w, where w is the error by the noise if h is known. The chart's centre
is imaged at c = F h - D g, by the map and the PSF's mark offset. A bin is located by its own samples
(`correspondences`), with r = n - A h - J g - ...: the sum of map and bin step does not depend on g, only on the noise
n, on h, and on F h, by which the marks fix the map's translation. The covariance of n with the fit's errors is that of
the fitted part of n, so that

    Cov(x, p) = Cov(F h - D_x g, p)

for the place x of a bin and any p that comes from the fit.
"""

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.kernel_prior import prior_covariance
from procedures.numerics.normal_equations import cholesky_inverse, solve_constrained
from procedures.pattern import CELLS
from procedures.pattern_psf.centre import mark_offset_gradient
from procedures.pattern_psf.refine import GEOMETRY, TAIL, ChartFit
from procedures.pattern_psf.registration import Registration
from procedures.psf import Psf, PsfTail


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Covariances shared by PSF, centre and map of a chart; P is the number of the PSF's parameters.

    centre : (P, 2) PSF's parameters with the image of the chart's centre, in pixels of the plane
    displacement : (18, P + 2) coefficients of the map's displacement with the PSF's parameters, then with that centre
    mark : (2, P + 2) mark offset of the PSF with the PSF's parameters, then with that centre
    middle : (9,) mean of the displacement's monomials over the samples, the fixed point of the map
    """

    centre: Array
    displacement: Array
    mark: Array
    middle: Array

    def of_points(self, registration: Registration, points: Array) -> Array:
        """Covariance (n, 2, P + 2) of bin positions (n, 2) with the PSF's parameters and centre."""
        monomials = registration.monomials(points) - self.middle
        halves = self.displacement.reshape(2, 9, -1)
        return np.asarray(self.mark - np.einsum("nm,amp->nap", monomials, halves))


@dataclass(frozen=True, eq=False)
class Solution:
    """PSF, covariance (2, 2) of the image of the chart's centre, and the covariances that both share with the map."""

    psf: Psf
    centre_covariance: Array
    shared: SharedErrors


def solution(fit: ChartFit, s: int, k: int, solver: str) -> Solution:
    """PSF of sum 1 by the requested solver, with the least-squares covariance: an upper limit for "clip" and "nnls"."""
    # covariance (k^2 + q, k^2 + q) of samples and tail before normalisation; given h, t = (Z'Z)^-1 (Z'r - Z'A h)
    equations = fit.equations
    of_tail = slice(GEOMETRY + TAIL, None)
    C, E = equations.inverse, equations.E[of_tail]
    cross = -C @ E.T
    conditional = cholesky_inverse(equations.ZZ)[of_tail, of_tail] - E @ cross
    covariance = np.block([[C, cross], [cross.T, conditional]]) * fit.residual_std**2
    h = _kernel(fit, covariance[: k * k, : k * k], s, solver)
    amplitudes = fit.light[TAIL:] + fit.equations.response(h - fit.h)[GEOMETRY + TAIL :]
    p, covariance = _normalised(np.concatenate([h, amplitudes]), covariance, len(h))
    # the centre follows the PSF: an error of h that shifts the PSF shifts the map back
    n, image = len(h), p[: len(h)].reshape(k, k)
    slope_y, slope_x = np.gradient(image)
    shift_gradient = np.zeros((len(p), 2))
    shift_gradient[:n] = np.column_stack([slope_x.ravel(), slope_y.ravel()]) * s
    F = mark_offset_gradient(image, s, fit.registration.jacobian())
    # derivative (2, 18) of the chart's centre by the displacement's coefficients, relative to the samples' mean
    middle = fit.registration.to_sensor(np.full((1, 2), CELLS / 2))
    D = np.kron(np.eye(2), fit.registration.monomials(middle)[0] - fit.observation.cubics.mean(axis=0))
    shared = _recentred(_shared(fit, covariance, F, D), F, shift_gradient)
    # covariance (2, 2), squared pixels, of the chart's centre: errors of h move the marks by `F`, and the displacement
    # has its own
    equations = fit.equations
    with_h = equations.E[:GEOMETRY] * fit.h.sum()
    conditional = cholesky_inverse(equations.ZZ)[:GEOMETRY, :GEOMETRY] * fit.residual_std**2
    moved = F + D @ with_h
    centre_covariance = np.asarray(moved @ covariance[:n, :n] @ moved.T + D @ conditional @ D.T)
    covariance = covariance + shift_gradient @ (F @ covariance[:n])
    covariance = covariance + (covariance[:, :n] @ F.T) @ shift_gradient.T
    tail = PsfTail(p[n:], covariance[n:, n:], covariance[:n, n:])
    return Solution(Psf(image, s, covariance[:n, :n], tail), centre_covariance, shared)


def _kernel(fit: ChartFit, covariance: Array, s: int, solver: str) -> Array:
    """Kernel (k^2,) by the solver, of the sum of the contrast's correction. As non-negativity keeps positive noise,
    "nnls" adds the prior of `prior_covariance`."""
    if solver == "ls":
        return fit.h
    G = fit.equations.G / fit.residual_std**2
    b = G @ fit.h
    if solver == "nnls":
        G = G + cholesky_inverse(prior_covariance(fit.h, covariance, s))
    return solve_constrained(G, b, solver)


def _normalised(p: Array, covariance: Array, n: int) -> tuple[Array, Array]:
    """Parameters divided by the sum of the first n, the samples, and their covariance to first order."""
    total = p[:n].sum()
    p = p / total
    # J C J' with J = (I - p 1_n') / total
    covariance = covariance - np.outer(p, covariance[:n].sum(axis=0))
    covariance = covariance - np.outer(covariance[:, :n].sum(axis=1), p)
    return p, covariance / total**2


def _shared(fit: ChartFit, covariance: Array, F: Array, D: Array) -> SharedErrors:
    """Covariances of the map's displacement with a PSF of sum 1 and its centre, before the samples follow their centre.

    F (2, n) is the derivative of the mark offset by the PSF, D (2, 18) that of the chart's centre by the displacement.
    """
    conditional = cholesky_inverse(fit.equations.ZZ)[:GEOMETRY] * fit.residual_std**2
    selected = np.hstack([conditional[:, :GEOMETRY], conditional[:, GEOMETRY + TAIL :]])
    middle, total = fit.observation.cubics.mean(axis=0), float(fit.h.sum())
    with_h = fit.equations.E[:GEOMETRY] * total
    n = with_h.shape[1]
    with_parameters = -with_h @ covariance[:n]
    with_parameters[:, n:] += selected[:, GEOMETRY:] / total
    itself = with_h @ covariance[:n, :n] @ with_h.T + selected[:, :GEOMETRY]
    with_centre = with_parameters[:, :n] @ F.T - itself @ D.T
    centre = covariance[:, :n] @ F.T - with_parameters.T @ D.T
    mark = np.hstack([F @ covariance[:n], F @ centre[:n]])
    return SharedErrors(centre, np.hstack([with_parameters, with_centre]), mark, middle)


def _recentred(shared: SharedErrors, F: Array, shift_gradient: Array) -> SharedErrors:
    """Covariances after the PSF's samples have followed their centre: h + shift_gradient F h."""
    n = F.shape[1]

    def recentred(with_parameters: Array) -> Array:
        return np.asarray(with_parameters + (with_parameters[:, :n] @ F.T) @ shift_gradient.T)

    displacement, mark = (
        np.hstack([recentred(one[:, :-2]), one[:, -2:]]) for one in (shared.displacement, shared.mark)
    )
    return SharedErrors(recentred(shared.centre.T).T, displacement, mark, shared.middle)
