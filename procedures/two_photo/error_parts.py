"""What the uncertainty of each number is made of: noise, model error in the residual, and the focus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.budget import Budget
from procedures.numerics.warps import inverse
from procedures.psf import Psf, PsfTail
from procedures.quality import Quality
from procedures.two_photo.inter_image import PairFit
from procedures.two_photo.likeness import Likeness, NearLook
from procedures.two_photo.near_noise import Kernel
from procedures.two_photo.recursion import Recovered, band, nearest

Array = npt.NDArray[np.float64]

COHERENT = 0.5
"""Of the amplitude that is left over at coarse detail, the share that may be an error of the kernel itself: light
turned on simulated relief gave 0.3 to 1.6, another response 0.7 to 1."""
FACTORS = 4
"""Of the recursion, in which another OTF of the near photograph tells."""
LIGHT_GROWS = 7.0
"""How much more the OTF is wrong at finer detail than `light_turned` tells: 6 to 8 times on simulated relief, by 3 to
10 degrees."""
NEVER_BELOW = 0.1
"""Cycles/pixel: at coarser detail an error of the kernel is one of the gain, which the recursion divides out."""


@dataclass(frozen=True)
class ErrorParts:
    """The parts of every number's uncertainty.

    Attributes
    ----------
    parts : mapping of str to Budget
    mismatch : mapping of str to float
        Variance of the numbers as the tiles' scatter tells it, over that which white noise would make.
    """

    parts: Mapping[str, Budget]
    mismatch: Mapping[str, float]


def likely_errors(alike: Likeness, recovered: Recovered, psf: Psf, J: Array) -> dict[str, Array]:
    """Errors of the PSF's parameters, one standard uncertainty each, by term: what is left over, and another focus.

    A near photograph whose OTF is exp(d) times the far one's divides K(f) by exp(d(f / lambda)), and H by the product
    of these over the recursion's factors.
    """
    fx, fy = band(psf.k, psf.s)
    H = psf.spectra(fx, fy) @ recovered.parameters
    onset = 1 - np.exp(-((np.hypot(fx, fy) / NEVER_BELOW) ** 2))
    moved = {
        "mismatch": COHERENT * alike.left_over * onset,
        "light": LIGHT_GROWS * alike.light_turned * onset,
        **dict(zip(("focus", "sharpening"), near_errors(alike.near, J, fx, fy), strict=True)),
    }
    return {term: _of_sum_one(nearest(H * share, psf.k), recovered) for term, share in moved.items()}


def near_errors(look: NearLook, J: Array, fx: Array, fy: Array) -> Array:
    """The logarithm of the factors that the near photograph's own OTF puts into H, at far frequencies (n,): (2, n), of
    its blur and of its sharpening."""
    M = inverse(J).T
    found = np.zeros((2, len(fx)))
    for _ in range(FACTORS):
        fx, fy = M[0, 0] * fx + M[0, 1] * fy, M[1, 0] * fx + M[1, 1] * fy
        found = found + look.log_modulus(fx, fy)
    return found


def widened(psf: Psf, errors: Mapping[str, Array]) -> Psf:
    """The same PSF with the errors in its covariance."""
    n, C = psf.k**2, psf.parameter_covariance + sum(np.outer(one, one) for one in errors.values())
    return replace(psf, covariance=C[:n, :n], tail=PsfTail(psf.tail.amplitudes, C[n:, n:], C[:n, n:]))


def error_parts(
    fit: PairFit, kernel: Kernel, recovered: Recovered, free: Psf, quality: Quality, errors: Mapping[str, Array]
) -> ErrorParts:
    """The uncertainties of all numbers taken apart.

    Parameters
    ----------
    free : Psf
        With the covariance of the photographs' noise alone.
    quality : Quality
        Of the PSF, its numbers' gradients.
    errors : mapping of str to (k^2 + q,) float64
        From `likely_errors`.
    """
    gradients = np.array(list(quality.gradients.values()))
    noise = np.maximum(np.einsum("ij,jk,ik->i", gradients, free.parameter_covariance, gradients), 0)
    told = tiles_say(fit, kernel, recovered, gradients)
    ratio = np.sum(told**2, axis=0) / np.maximum(noise, 1e-300)
    systematic = {term: gradients @ error for term, error in errors.items()}
    scattered = np.maximum(ratio - 1, 0) * noise + systematic["mismatch"] ** 2
    parts = {
        name: {
            "noise": float(np.sqrt(noise[i])),
            "mismatch": float(np.sqrt(scattered[i])),
            "light": abs(float(systematic["light"][i])),
            "focus": float(np.hypot(systematic["focus"][i], systematic["sharpening"][i])),
        }
        for i, name in enumerate(quality.gradients)
    }
    return ErrorParts(parts, dict(zip(quality.gradients, ratio.tolist(), strict=True)))


def tiles_say(fit: PairFit, kernel: Kernel, recovered: Recovered, gradients: Array) -> Array:
    """What each tile of the region adds to each number, (tiles, b): it scatters as noise does where all agree.

    `gradients` (b, k^2 + q) are by the PSF's parameters.
    """
    total, n = float(recovered.h.sum()), recovered.h.size
    by_recovered = gradients.copy()
    by_recovered[:, :n] -= (gradients @ recovered.parameters / total)[:, None]
    by_kernel = by_recovered @ recovered.derivative / total
    weights = kernel.inverse @ by_kernel.T
    kept, nuisance = np.split(fit.scores, [len(weights)], axis=1)
    kept = kept + np.outer(fit.counts / fit.counts.sum(), kernel.given_back)
    return np.asarray(kept @ weights - nuisance @ (fit.equations.E @ weights))


def _of_sum_one(change: Array, recovered: Recovered) -> Array:
    """A change of the recovered parameters as one of those whose samples have the sum 1."""
    n, total = recovered.h.size, float(recovered.h.sum())
    return np.asarray((change - recovered.parameters / total * change[:n].sum()) / total)
