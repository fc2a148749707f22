"""Predicted uncertainty of the PSF from a wall's texture: what each further distance will contribute.

A far photograph from z times the near distance has M = H W / z^2 samples of the near photograph's part of the wall. On
the grid of s samples per far pixel, the near photograph has the autocorrelation R, and the kernel's normal equations
are M R / sigma^2. Those of several distances add up.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from procedures.numerics.arrays import Array, Array32
from procedures.numerics.normal_equations import cholesky_inverse

DISTANCES = (3.2, 4.0, 5.0, 6.3)
"""Distances of far photographs over that of the near one, for which the uncertainty is predicted."""
REPORTED = 1.4
"""Reported uncertainty by noise over that of the kernel alone, because of recursion, registration and light: 1.3 to 1.5
for walls of two kinds from 3.45, 4.6 and 5.75 times the near distance."""
HALF = 0.5  # MTF at the predicted frequency, by which its derivative by the sum of the kernel is weighted
RIDGE = 1e-9
"""Relative to the mean diagonal: the near photograph's own blur leaves the band's corners almost without texture."""


def noise_of_two(first: Array32, second: Array32) -> float:
    """Standard deviation of the noise by two photographs of one scene from one place, whose light may differ."""
    difference = first - second * (float(np.mean(first)) / float(np.mean(second)))
    return float(1.4826 * np.median(np.abs(difference - np.median(difference))) / math.sqrt(2))


def together(uncertainties: Sequence[float]) -> float:
    """Uncertainty by several far photographs together: their information adds up."""
    return 1 / math.sqrt(sum(1 / uncertainty**2 for uncertainty in uncertainties))


def information(near: Array32, ratio: float, noise: float, s: int, k: int) -> Array:
    """Information matrix (k^2, k^2) of the kernel by a far photograph from `ratio` times the near distance.

    near : (rows, columns) the near photograph, linear
    noise : float, standard deviation of the far photograph's noise, in its units
    """
    rows, columns = (int(n * s / ratio) for n in near.shape)
    texture = cv2.resize(near, (columns, rows), interpolation=cv2.INTER_AREA).astype(np.float64)
    window = np.outer(np.hanning(rows + 2)[1:-1], np.hanning(columns + 2)[1:-1])
    texture = (texture - texture.mean()) * window
    padded = rows + k, columns + k
    power = np.abs(np.fft.rfft2(texture, padded)) ** 2
    correlation = np.fft.irfft2(power, padded) / np.sum(window**2)
    y, x = np.divmod(np.arange(k * k), k)
    R = correlation[y[:, None] - y, x[:, None] - x]
    return np.asarray(near.size / ratio**2 / noise**2 * R)


def predicted_uncertainty(near: Array32, ratio: float, noise: float) -> float:
    """Standard uncertainty of the MTF along rows at Nyquist's frequency by the noise of a far photograph, whose
    distance is `ratio` times that of the near one, more than 3."""
    s, k = 3, 13
    G = information(near, ratio, noise, s, k)
    G = G + RIDGE * np.trace(G) / len(G) * np.eye(len(G))
    wave = np.tile(np.cos(np.pi * (np.arange(k) - k // 2) / s), k) - HALF
    return REPORTED * float(np.sqrt(wave @ cholesky_inverse(G) @ wave))
