"""Deconvolution of one tile from the samples of its planes: a convex problem, solved by splitting (ADMM).

Minimise  sum_p sum_x w_p(x) (z_p(x) - (h_p * u_c(p))(x))^2 / 2  +  tau sum_x |S M D u|(x)

over the colours u_c of the picture. w_p is one over the variance of a sample, and 0 where plane p has none: where the
mosaic has another colour, at clipped highlights, and beyond the frame. Demosaicking, deblurring and extrapolation
beyond the rim thus are one problem. M gives lightness and weighted colour, and S(x) subtracts from the differences of
colour those that the differences of lightness predict: near each pixel, all colours change along one line, fitted to
the first picture, and before the last third of the iterations to the restored one. With copies
v_p = h_p * u_c and y = M D u, the part that couples pixels is diagonal over frequencies, and the part that couples
frequencies is local to each pixel.

Source: Almeida, Figueiredo, Deconvolving images with unknown boundaries using ADMM, IEEE TIP 22 (2013).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.fft

from procedures.correction.priors import Prior
from procedures.correction.steps import agree, differences, divergence, length, mixed, shrink, solve

Single = npt.NDArray[np.float32]
Spectrum = npt.NDArray[np.complex64]

DETAIL_PX = 1.5
"""Standard deviation of the smoothing of a photograph whose detail is measured."""
SMOOTH_PX, WINDOW_PX = 0.8, 15
"""Standard deviation of the smoothing, and side of the window, of the local relation of colour to lightness."""


@dataclass(frozen=True)
class Splitting:
    """Parameters of the solver: number of iterations, and penalties that tie the copies to their originals.

    data : largest, relative to weights of 1, which is their mean over all samples.
    prior : relative to the strength tau over the picture's mean difference.
    ratio : largest of data over prior: more, and few iterations amplify what demosaicking could not determine.
    """

    iterations: int = 12
    data: float = 0.1
    prior: float = 0.7
    ratio: float = 70.0


@dataclass(frozen=True, eq=False)
class DeconvolutionTile:
    """Data of a tile of n x n samples.

    z, weight : (P, n, n) float32
        Samples of each plane, and one over their variance, in units that make it about 1.
    otf : (P, n, n // 2 + 1) complex64
        Transfer functions of the planes' PSFs.
    channel : (P,)
        Colour of each plane.
    """

    z: Single
    weight: Single
    otf: Spectrum
    channel: Sequence[int]

    @property
    def n(self) -> int:
        """Samples along one side."""
        return int(self.z.shape[-1])

    @property
    def channels(self) -> int:
        """Colours of the picture."""
        return max(self.channel) + 1

    def blurred(self, U: Spectrum) -> Single:
        """The planes (P, n, n) of a picture with this spectrum."""
        spectra = np.empty_like(self.otf)
        for p, c in enumerate(self.channel):
            np.multiply(self.otf[p], U[c], out=spectra[p])
        return _transformed_back(spectra, self.n)


def deconvolve(
    tile: DeconvolutionTile, start: Single, prior: Prior, tau: float, gradient: float, settings: Splitting
) -> Single:
    """The picture (C, n, n) of minimal cost.

    start : (C, n, n) float32
        Initial picture, blurred as the samples are.
    tau : float
        Strength of the prior.
    gradient : float
        Mean length of the picture's differences, which scales the penalty.
    """
    penalty = np.float32(settings.prior * tau / gradient)
    rho = min(np.float32(settings.data), np.float32(settings.ratio) * penalty)
    solver = _Solver.of(tile, prior, float(rho), float(penalty))
    M = prior.mixing(tile.channels).astype(np.float32)
    u, data_dual = start, np.zeros_like(tile.z)
    prior_dual = np.zeros((prior.kinds, *start.shape), dtype=np.float32)
    copies = np.where(tile.weight > 0, tile.z, start[list(tile.channel)])
    for left in reversed(range(settings.iterations)):
        if left in (settings.iterations - 1, settings.iterations // 3):
            slopes = _slopes(u, prior, tau * gradient) if len(u) > 1 else None
        gradients = differences(mixed(M, u), prior.second)
        shrink(gradients, prior_dual, np.float32(tau / penalty), slopes)
        target = mixed(np.ascontiguousarray(M.T), divergence(gradients, prior.second))
        U = solver(scipy.fft.rfft2(copies), scipy.fft.rfft2(target))
        if left:
            predicted = tile.blurred(U)
            agree(predicted, copies, tile.z, tile.weight, data_dual, rho)
            copies = predicted
        u = _transformed_back(U, tile.n)
    return u


def mean_difference(u: Single, prior: Prior) -> float:
    """Mean length of a picture's differences (C, n, n) in the metric of the prior."""
    M = prior.mixing(len(u)).astype(np.float32)
    return float(length(differences(mixed(M, np.ascontiguousarray(u)), prior.second)).mean())


def detail(u: Single) -> float:
    """Mean length of the differences of the lightness of a picture (C, n, n), smoothed against noise."""
    import cv2

    smooth = cv2.GaussianBlur(u.mean(axis=0), (0, 0), DETAIL_PX)
    return float(length(differences(np.asarray(smooth, dtype=np.float32)[None], second=False)).mean())


def _slopes(u: Single, prior: Prior, noise: float) -> Single:
    """Local slopes (2, n, n) of the weighted differences of colour over those of lightness, by regression.

    u : (C, n, n) picture, smoothed here as its finest detail is ambiguous; noise : added to the mean square difference
    """
    import cv2

    M = prior.mixing(len(u)).astype(np.float32)
    smooth = np.stack([cv2.GaussianBlur(one, (0, 0), SMOOTH_PX) for one in u])
    lightness, *colours = np.moveaxis(differences(mixed(M, smooth), prior.second), 1, 0)
    square = _local_mean(lightness * lightness) + np.float32(noise)
    return np.stack([_local_mean(lightness * colour) / square for colour in colours])


def _local_mean(d: Single) -> Single:
    """Mean (n, n) over a window of the sum over kinds (K, n, n)."""
    import cv2

    return np.asarray(cv2.blur(d.sum(axis=0), (WINDOW_PX, WINDOW_PX)), dtype=np.float32)


def _transformed_back(F: Spectrum, n: int) -> Single:
    """Samples of spectra, which are overwritten."""
    return np.asarray(scipy.fft.irfft2(F, (n, n), overwrite_x=True), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class _Solver:
    """The picture's spectrum nearest to all copies: inverse of a diagonal plus rank-one matrix at each frequency."""

    conjugate: Spectrum
    channel: npt.NDArray[np.int64]
    inverse: Single
    coupled: Single
    penalty: np.float32
    data: np.float32

    @classmethod
    def of(cls, tile: DeconvolutionTile, prior: Prior, data: float, penalty: float) -> "_Solver":
        power = np.zeros((tile.channels, *tile.otf.shape[1:]))
        for p, c in enumerate(tile.channel):
            power[c] += np.abs(tile.otf[p]) ** 2
        chroma = prior.chroma**2 if tile.channels > 1 else 1.0
        stiff = penalty * prior.power(tile.n)
        inverse = 1 / np.maximum(data * power + chroma * stiff, 1e-12)
        # M^T M = chroma 1 - (chroma - 1) b b^T with b = (1, 1, 1) / sqrt(3): Sherman and Morrison
        off = (chroma - 1) * stiff / tile.channels
        coupled = off / np.maximum(1 - off * inverse.sum(axis=0), 1e-12)
        return cls(
            np.conj(tile.otf), np.array(tile.channel), inverse.astype(np.float32), coupled.astype(np.float32),
            np.float32(penalty), np.float32(data),
        )  # fmt: skip

    def __call__(self, targets: Spectrum, pulled: Spectrum) -> Spectrum:
        out = np.empty_like(pulled)
        solve(
            targets, self.conjugate, self.channel, pulled, self.inverse, self.coupled, self.data, self.penalty, out
        )  # fmt: skip
        return out
