"""How sharp the picture behind the photographs is expected to be: its prior's variance, from their spectra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import next_fast_len, rfft2
from scipy.ndimage import gaussian_filter

from procedures.restoration.fields import Masks
from procedures.restoration.forward import Array

# values tried, white = 1 squared: from a smooth sky to black on white
LEAST, GREATEST, TRIED = 1e-6, 0.3, 60
# real pictures and drawn ones have this part, within a factor of 1.5, of what a spectrum that falls as 1 / L suggests
PART = 0.55
# noise tried, of the estimate: too little would make sharpness of it
NOISES = np.geomspace(0.5, 2.0, 9)
# depths whose masks stand for all, as percentiles of w
STANDING = (10, 30, 50, 70, 90)


def sharpness_of(z: Array, stacks: Sequence[Masks], w: Array, sigma: float) -> float:
    """Sum of the mean squared differences of neighbours down and across, expected of the sharp picture, white = 1.

    The quadratic prior gives the picture the spectrum S / L(f), L of the Laplacian; a photograph has
    |H(f)|^2 S / L(f) + sigma^2, |H|^2 the mean over the depths that occur. S is the most likely one for all the
    photographs' periodograms (Whittle 1953). z : (P, C, H, W); w : (H, W) pixels; sigma : noise, white = 1.
    """
    shape = tuple(next_fast_len(n, True) for n in z.shape[2:])
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None, :]
    laplacian = 4 - 2 * np.cos(2 * np.pi * fy) - 2 * np.cos(2 * np.pi * fx)
    # what is wider than some ten pixels is light and shade, which no photograph has lost
    counted = laplacian > 0.3
    depths = np.percentile(w, STANDING)
    values = np.geomspace(LEAST, GREATEST, TRIED)
    unlikely = np.zeros((TRIED, len(NOISES)))
    for photograph, stack in zip(z, stacks, strict=True):
        passed = np.mean([np.abs(rfft2(stack.at(float(d)), shape)) ** 2 for d in depths], axis=0)
        power = _periodogram(photograph, shape)[counted]
        ratio = (passed / np.maximum(laplacian, 1e-12))[counted]
        for k, n in np.ndindex(unlikely.shape):
            expected = values[k] * ratio + (NOISES[n] * sigma) ** 2
            unlikely[k, n] += np.sum(np.log(expected) + power / expected)
    return PART * float(values[np.unravel_index(unlikely.argmin(), unlikely.shape)[0]])


def _periodogram(photograph: Array, shape: tuple[int, ...]) -> Array:
    """Power per frequency, mean over channels, in a window of unit mean square: white noise gives its variance."""
    H, W = photograph.shape[1:]
    window = np.outer(*(np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2 for n in (H, W)))
    window /= np.sqrt(np.mean(window**2))
    detail = photograph - gaussian_filter(photograph, (0, 20, 20))
    return np.asarray(np.mean(np.abs(rfft2(detail * window, shape)) ** 2, axis=0) / (H * W))
