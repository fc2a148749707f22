"""How sharp the picture behind the photographs is expected to be: its prior's variance, from their spectra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import next_fast_len, rfft2
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize

from procedures.restoration.fields import Masks
from procedures.restoration.forward import Array

# bounds, white = 1 squared: from a smooth sky to black on white
LEAST, GREATEST = 1e-6, 0.3
# of what a spectrum that falls as 1 / L suggests, this part suits pictures of known truth: they fall off faster
PART = 0.4
# noise is fitted too, within this factor of its estimate: too little would make sharpness of it
NOISE_FACTOR = 2.0
# the middle of large photographs stands for all
LARGEST_PART = 512
# depths whose masks stand for all, as percentiles of w
STANDING = (10, 30, 50, 70, 90)


def sharpness_of(z: Array, stacks: Sequence[Masks], w: Array, sigma: float) -> float:
    """Sum of the mean squared differences of neighbours down and across, expected of the sharp picture, white = 1.

    The quadratic prior gives the picture the spectrum S / L(f), L of the Laplacian; a photograph has
    |H(f)|^2 S / L(f) + sigma^2, |H|^2 the mean over the depths that occur. S is the most likely one for all the
    photographs' periodograms (Whittle 1953). z : (P, C, H, W); w : (H, W) pixels; sigma : noise, white = 1.
    """
    z = _middle(z)
    shape = (next_fast_len(z.shape[2], True), next_fast_len(z.shape[3], True))
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None, :]
    laplacian = 4 - 2 * np.cos(2 * np.pi * fy) - 2 * np.cos(2 * np.pi * fx)
    # what is wider than some ten pixels is light and shade, which no photograph has lost
    counted = laplacian > 0.3
    depths = np.percentile(w, STANDING)
    power = np.stack([_periodogram(photograph, shape)[counted] for photograph in z])
    passed = np.stack([np.mean([np.abs(rfft2(s.at(float(d)), shape)) ** 2 for d in depths], axis=0) for s in stacks])
    ratio = passed[:, counted] / laplacian[counted]

    def unlikely(logarithms: Array) -> float:
        value, noise = np.exp(logarithms)
        expected = value * ratio + noise**2
        return float(np.mean(np.log(expected) + power / expected))

    limits = [(LEAST, GREATEST), (sigma / NOISE_FACTOR, sigma * NOISE_FACTOR)]
    start, bounds = np.log([5e-3, sigma]), np.log(limits)
    found = minimize(unlikely, start, method="Nelder-Mead", bounds=bounds, options={"xatol": 0.01, "fatol": 1e-9})
    return PART * float(np.exp(found.x[0]))


def _middle(z: Array) -> Array:
    y, x = (max(0, (n - LARGEST_PART) // 2) for n in z.shape[2:])
    return z[:, :, y : y + LARGEST_PART, x : x + LARGEST_PART]


def _periodogram(photograph: Array, shape: tuple[int, ...]) -> Array:
    """Power per frequency, mean over channels, in a window of unit mean square: white noise gives its variance."""
    H, W = photograph.shape[1:]
    window = np.outer(*(np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2 for n in (H, W)))
    window /= np.sqrt(np.mean(window**2))
    detail = photograph - gaussian_filter(photograph, (0, 20, 20))
    return np.asarray(np.mean(np.abs(rfft2(detail * window, shape)) ** 2, axis=0) / (H * W))
