"""How far a picture restored from mosaics may be from the scene: mosaics made of it are restored once more.

Demosaicking guesses what was not sampled, which the planes' own restoration does not know of. The restored picture,
blurred, sampled and made noisy, comes back without what the prior takes; that is given to it first, as the scene had
what the picture has lost.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter

from procedures.restoration.colour.picture import MosaicTerm, alone
from procedures.restoration.masks.blur_operator import Array

LOST = 2.0
"""How often what the prior takes of the picture is given back: the picture, having lost it once, loses less than the
scene did. With 2 of five pictures 91 to 99 % of the values were within two of what is told, with 1 86 to 96 %."""
START = 1.5
"""Radius by which the picture is blurred before it is looked for again, pixels."""


def error_of(data: MosaicTerm, u: Array, w: Array, sigma: float, left: float, rounds: int = 3) -> Array:
    """What u (3, H', W'), lightness and differences of colour, may be off by: one example of it, (3, H', W').

    w : (H', W'); sigma : noise that the prior's strength was chosen by; left : what the mosaics' samples keep over.
    """
    lost = u - _once_more(data, u, w, sigma, 0.0, rounds)
    scene = u + LOST * lost
    return _once_more(data, scene, w, sigma, left, rounds) - scene


def _once_more(data: MosaicTerm, scene: Array, w: Array, sigma: float, noise: float, rounds: int) -> Array:
    """The picture restored from mosaics of a scene."""
    data.focus(w)
    seen = data.blur(scene)
    seen = seen + noise * np.random.default_rng(0).standard_normal(seen.shape).astype(seen.dtype)
    z = np.divide(seen, data.trust, out=np.zeros_like(seen), where=data.trust > 0)
    again = MosaicTerm(z, data.blurs, data.trust)
    return alone(again, gaussian_filter(scene, (0, START, START)), w, sigma, rounds, 20)


def spread_out(error: Array, window: int) -> Array:
    """Standard deviation (H, W) of an example of errors (C, H, W), from the windows about every pixel."""
    return np.asarray(np.sqrt(uniform_filter((error.astype(np.float64) ** 2).mean(axis=0), window)))
