"""Error of a picture restored from mosaics, estimated by restoring simulated mosaics of it.

Demosaicking interpolates what was not sampled, an error unknown to the restoration of the planes. The restored picture
is blurred, sampled with noise and restored again, which shows the loss due to the prior. That loss is added to the
picture first, as the scene contained it.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter

from procedures.restoration.colour.picture import MosaicTerm, alone
from procedures.restoration.masks.blur_operator import Array

LOST = 2.0
"""Factor of the loss added to the picture, which has lost it once and loses less than the scene did. For five pictures,
91 to 99 % of the values were within two estimated errors with 2, and 86 to 96 % with 1."""
START = 1.5
"""Radius of the initial blur of the picture before it is restored again, pixels."""


def error_of(data: MosaicTerm, u: Array, w: Array, sigma: float, residual: float) -> Array:
    """An example of the error of u (3, H', W'), lightness and differences of colour, (3, H', W').

    w : (H', W'); sigma : noise from which the prior's strength derives; left : standard deviation of the residual.
    """
    lost = u - _once_more(data, u, w, sigma, 0.0)
    scene = u + LOST * lost
    return _once_more(data, scene, w, sigma, residual) - scene


def _once_more(data: MosaicTerm, scene: Array, w: Array, sigma: float, noise: float) -> Array:
    data.focus(w)
    samples = data.blur(scene)
    samples = samples + noise * np.random.default_rng(0).standard_normal(samples.shape).astype(samples.dtype)
    z = np.divide(samples, data.trust, out=np.zeros_like(samples), where=data.trust > 0)
    again = MosaicTerm(z, data.blurs, data.trust)
    return alone(again, gaussian_filter(scene, (0, START, START)), w, sigma, 3, 20)


def spread_out(error: Array, window: int) -> Array:
    """Local standard deviation (H, W) of an example of errors (C, H, W), from windows about every pixel."""
    return np.asarray(np.sqrt(uniform_filter((error.astype(np.float64) ** 2).mean(axis=0), window)))
