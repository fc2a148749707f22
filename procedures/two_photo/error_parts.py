"""Uncertainty budgets of the numbers: noise, model error in the residual, and focus."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.choice import Budget
from procedures.numerics.warps import inverse
from procedures.psf import Psf
from procedures.quality import Quality
from procedures.two_photo.inter_image import PairFit
from procedures.two_photo.near_noise import InterImageKernel
from procedures.two_photo.pair_consistency import NearSpectrum, PairConsistency
from procedures.two_photo.recursion import Recovered, band, nearest

Array = npt.NDArray[np.float64]

COHERENT = 0.5
"""Share of the residual's amplitude at coarse detail that may be an error of the kernel: rotated light on simulated
relief gave 0.3 to 1.6, another response 0.7 to 1."""
FACTORS = 4  # factors of the recursion that are affected by another OTF of the near photograph
LIGHT_GROWTH = 7.0
"""Error of the OTF at finer detail, relative to `light_turned`: 6 to 8 on simulated relief, by 3 to 10 degrees."""
GAIN_BAND = 0.1  # cycles/pixel below which an error of the kernel is one of the gain, which the recursion divides out


@dataclass(frozen=True)
class PairErrorParts:
    """Uncertainty budgets of the numbers.

    parts : mapping of str to Budget
    mismatch : variance of the numbers by the scatter of the tiles, over that by white noise
    """

    parts: Mapping[str, Budget]
    mismatch: Mapping[str, float]


def likely_errors(consistency: PairConsistency, recovered: Recovered, psf: Psf, J: Array) -> dict[str, Array]:
    """Errors of the PSF's parameters, one standard uncertainty each, by term: residual, light, focus, sharpening.

    A near photograph whose OTF is exp(d) times the far one's divides K(f) by exp(d(f / lambda)), and H by the product
    of these over the recursion's factors.
    """
    fx, fy = band(psf.k, psf.s)
    H = psf.spectra(fx, fy) @ recovered.parameters
    onset = 1 - np.exp(-((np.hypot(fx, fy) / GAIN_BAND) ** 2))
    focus, sharpening = near_errors(consistency.near, J, fx, fy)
    relative = {
        "mismatch": COHERENT * consistency.coarse_residual * onset,
        "light": LIGHT_GROWTH * consistency.light_turned * onset,
        "focus": focus,
        "sharpening": sharpening,
    }
    return {term: _normalised_change(nearest(H * share, psf.k), recovered) for term, share in relative.items()}


def near_errors(spectrum: NearSpectrum, J: Array, fx: Array, fy: Array) -> Array:
    """Logarithm of the factors in H by the near photograph's blur and sharpening, at far frequencies (n,): (2, n)."""
    M = inverse(J).T
    total = np.zeros((2, len(fx)))
    for _ in range(FACTORS):
        fx, fy = M[0, 0] * fx + M[0, 1] * fy, M[1, 0] * fx + M[1, 1] * fy
        total = total + spectrum.log_modulus(fx, fy)
    return total


def widened(psf: Psf, errors: Mapping[str, Array]) -> Psf:
    """The PSF with the errors included in its covariance."""
    C = psf.parameter_covariance + sum(np.outer(error, error) for error in errors.values())
    return Psf.of(psf.parameters, C, psf.k, psf.s)


def error_parts(
    fit: PairFit, kernel: InterImageKernel, recovered: Recovered, free: Psf, quality: Quality,
    errors: Mapping[str, Array],
) -> PairErrorParts:  # fmt: skip
    """Uncertainty budgets of all numbers.

    free : with the covariance of the photographs' noise alone
    quality : numbers of the PSF, and their gradients
    errors : mapping of str to (k^2 + q,); from `likely_errors`
    """
    gradients = np.array(list(quality.gradients.values()))
    noise = np.maximum(np.einsum("ij,jk,ik->i", gradients, free.parameter_covariance, gradients), 0)
    by_tile = tile_contributions(fit, kernel, recovered, gradients)
    ratio = np.sum(by_tile**2, axis=0) / np.maximum(noise, 1e-300)
    systematic = {term: gradients @ error for term, error in errors.items()}
    terms = {
        "noise": np.sqrt(noise),
        "mismatch": np.sqrt(np.maximum(ratio - 1, 0) * noise + systematic["mismatch"] ** 2),
        "light": np.abs(systematic["light"]),
        "focus": np.hypot(systematic["focus"], systematic["sharpening"]),
    }
    parts = {name: {term: float(v[i]) for term, v in terms.items()} for i, name in enumerate(quality.gradients)}
    return PairErrorParts(parts, dict(zip(quality.gradients, ratio.tolist(), strict=True)))


def tile_contributions(fit: PairFit, kernel: InterImageKernel, recovered: Recovered, gradients: Array) -> Array:
    """Contribution of each tile of the region to each number, (tiles, b), with the scatter of noise where all agree.

    `gradients` (b, k^2 + q) are by the PSF's parameters.
    """
    total, n = float(recovered.h.sum()), recovered.h.size
    by_recovered = gradients.copy()
    by_recovered[:, :n] -= (gradients @ recovered.parameters / total)[:, None]
    by_kernel = by_recovered @ recovered.derivative / total
    weights = kernel.inverse @ by_kernel.T
    scores, nuisance = np.split(fit.scores, [len(weights)], axis=1)
    scores = scores + np.outer(fit.counts / fit.counts.sum(), kernel.noise_correction)
    return np.asarray(scores @ weights - nuisance @ (fit.equations.E @ weights))


def _normalised_change(change: Array, recovered: Recovered) -> Array:
    """A change of the recovered parameters after normalisation to sum 1."""
    n, total = recovered.h.size, float(recovered.h.sum())
    return np.asarray((change - recovered.parameters / total * change[:n].sum()) / total)
