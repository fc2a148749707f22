"""Kernels of maximal probability for a picture with sparse gradients, marginalised over the picture's values.

Every difference of neighbours is Gaussian with its own variance, estimated from the photographs; its posterior variance
adds a weight to the kernels' squares, so that kernels no wider than the noise allows are preferred to those that share
a blur with the picture.

Source: Wipf and Zhang, J. Machine Learning Research 2014; Zhang, Wipf and Zhang, CVPR 2013 (several photographs).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from procedures.restoration.joint.data_term import conjugate_gradients
from procedures.restoration.unknown_motion.free_kernels import Kernels, least_squares, thin

Gradients = NDArray[np.float32]
"""(2, ..., H, W): differences down and across."""
WARM = 3
"""Rounds of the picture alone, before its kernels are updated."""
THINNED = 5
"""Rounds between two removals of noise from the kernels."""


@dataclass(frozen=True)
class SparseFit:
    """Kernels, variance of their residual in the photographs' differences, and minus log probability per sample."""

    kernels: Kernels
    residual: float
    cost: float


class SparseGradients:
    """Gradients of photographs (P, H, W), for kernels of half-size R; the surroundings are unconstrained."""

    def __init__(self, z: Gradients, R: int) -> None:
        self.R = R
        self.observed = np.stack([np.diff(z, axis=1)[:, :, :-1], np.diff(z, axis=2)[:, :-1]])
        self.frame: tuple[int, ...] = self.observed.shape[2:]
        self.size = tuple(n + 2 * R for n in self.frame)
        self.padded = tuple(next_fast_len(n, True) for n in self.size)
        self.share = float(np.prod(self.frame) / np.prod(self.size))

    def fit(self, kernels: Kernels, rounds: int, iterations: int, least: float) -> SparseFit:
        """The kernels after a number of rounds. iterations : conjugate gradients of each; least : as in `thin`."""
        R, samples = self.R, self.observed.size
        x = np.pad(self.observed.mean(axis=1), ((0, 0), (R, R), (R, R)))
        noise = 0.01 * float(np.mean(self.observed**2))
        variance = x**2 + np.mean(x**2)
        for n in range(rounds):
            x = self._picture(x, kernels, (noise / variance).astype(np.float32), iterations)
            uncertain = 1 / ((kernels**2).sum() / noise + 1 / variance)
            variance = x**2 + uncertain
            uncertainty = self.share * float(uncertain.sum())
            if n >= WARM:
                kernels = self._kernels(x, kernels, uncertainty)
                kernels = thin(kernels, least) if n % THINNED == 0 else kernels
            squares = float((self._residual(x, kernels) ** 2).sum())
            noise = (squares + uncertainty * float((kernels**2).sum())) / samples
        terms = np.log1p(variance * float((kernels**2).sum()) / noise) + x**2 / variance
        cost = samples * np.log(noise) + squares / noise + float(terms.sum())
        return SparseFit(thin(kernels, least), noise, cost / samples)

    def _picture(self, x: Gradients, kernels: Kernels, weight: Gradients, iterations: int) -> Gradients:
        """Gradients of least |h * x - z|^2 + weight x^2, by conjugate gradients with the diagonal as preconditioner."""
        H = rfft2(kernels, self.padded)
        gradient = self._adjoint(H, self.observed - self._blurred(H, x)) - weight * x
        near = (kernels**2).sum() + weight
        step: Gradients = conjugate_gradients(
            lambda p: self._adjoint(H, self._blurred(H, p)) + weight * p, gradient, iterations, near, 1e-6
        )
        x = x + step
        # denormal numbers of float32 take ten times as long
        return np.where(np.abs(x) < 1e-8, np.float32(0), x)

    def _kernels(self, x: Gradients, kernels: Kernels, uncertainty: float) -> Kernels:
        X, K = rfft2(x, self.padded), 2 * self.R + 1
        residual = self._spectra_of_frames(self._residual(x, kernels))
        gradient = irfft2((X.conj()[:, None] * residual).sum(axis=0), self.padded)[:, :K, :K]
        correlation = self.share * irfft2((np.abs(X) ** 2).sum(axis=0), self.padded)
        far = np.arange(-2 * self.R, 2 * self.R + 1)
        return least_squares(kernels, gradient, correlation[np.ix_(far, far)], uncertainty, 150)

    def _residual(self, x: Gradients, kernels: Kernels) -> Gradients:
        residual: Gradients = self.observed - self._blurred(rfft2(kernels, self.padded), x)
        return residual

    def _blurred(self, H: NDArray[np.complex64], x: Gradients) -> Gradients:
        blurred: Gradients = irfft2(rfft2(x, self.padded)[:, None] * H, self.padded)[self._frames]
        return blurred

    def _adjoint(self, H: NDArray[np.complex64], e: Gradients) -> Gradients:
        back = irfft2((self._spectra_of_frames(e) * H.conj()).sum(axis=1), self.padded)
        inside: Gradients = back[:, : self.size[0], : self.size[1]]
        return inside

    def _spectra_of_frames(self, e: Gradients) -> NDArray[np.complex64]:
        wide = np.zeros((*e.shape[:2], *self.padded), np.float32)
        wide[self._frames] = e
        spectra: NDArray[np.complex64] = rfft2(wide)
        return spectra

    @property
    def _frames(self) -> tuple[slice, ...]:
        """Indices of the photographs (2, P, H, W) within the periodic grid."""
        return slice(None), slice(None), *(slice(2 * self.R, 2 * self.R + n) for n in self.frame)
