"""Sensitivity of a flat scene's picture to the estimation of its kernels.

Two searches from different starts end in kernels that explain the photographs about equally well. The difference of
their pictures is in no residual: it is a lower bound of the error due to the kernels. Common errors are not in it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft2, fftfreq, ifft2
from scipy.ndimage import uniform_filter

from procedures.restoration.masks.blur_operator import Array

Spectra = NDArray[np.complex128]


def picture_change(sharp: Array, kernels: Array, others: Array, weight: float) -> Array:
    """Local root mean square (H, W) of the difference of two pictures, without a common shift.

    sharp : (C, H, W), as restored with the kernels; kernels, others : (P, K, K) each, one sample a pixel, of sum 1, of
    the two searches; weight : of the picture's gradients.

    The photographs are modelled as the picture through the kernels. Kernels h then restore it by the filter
    sum conj(h) h / (sum |h|^2 + weight |gradient|^2), the others g by sum conj(g) h / (sum |g|^2 + weight ...).
    """
    rim = kernels.shape[1]
    u = np.pad(sharp.astype(np.float64), ((0, 0), (rim, rim), (rim, rim)), mode="reflect")
    H, G = (_spectra(each, u.shape[1:]) for each in (kernels, others))
    across = [2 - 2 * np.cos(2 * np.pi * fftfreq(n)) for n in u.shape[1:]]
    stiff = weight * (across[0][:, None] + across[1])
    change = (G.conj() * H).sum(axis=0) / (np.sum(np.abs(G) ** 2, axis=0) + stiff)
    change -= np.sum(np.abs(H) ** 2, axis=0) / (np.sum(np.abs(H) ** 2, axis=0) + stiff)
    difference = ifft2(change * fft2(u)).real[:, rim:-rim, rim:-rim]
    power = np.mean(_unshifted(difference, sharp) ** 2, axis=0)
    return np.asarray(np.sqrt(np.maximum(uniform_filter(power, rim, mode="reflect"), 0)))


def _spectra(kernels: Array, size: tuple[int, ...]) -> Spectra:
    """Spectra of kernels with their common centroid at the origin."""
    K = kernels.shape[1]
    wide = np.zeros((len(kernels), *size))
    wide[:, :K, :K] = kernels
    y, x = (float(np.arange(K) @ kernels.mean(axis=0).sum(axis=axis)) for axis in (1, 0))
    fy, fx = fftfreq(size[0])[:, None], fftfreq(size[1])
    return np.asarray(fft2(wide) * np.exp(2j * np.pi * (fy * y + fx * x)))


def _unshifted(difference: Array, sharp: Array) -> Array:
    """The difference without the part explained by a shift of the picture."""
    slopes = np.stack([one.ravel() for one in np.gradient(sharp.astype(np.float64), axis=(-2, -1))], axis=1)
    shift, *_ = np.linalg.lstsq(slopes, difference.ravel(), rcond=None)
    return np.asarray(difference - (slopes @ shift).reshape(difference.shape))
