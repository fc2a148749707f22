"""The light of a thin line that each pixel gets, told from samples as the masks of shapes are, and how it changes.

Masks of shapes are sums of samples (`blur_models.mask`), and a line narrower than the samples' spacing gets more or
less light as it lies: masks of curves must err likewise, or curves bend to make up for it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.numerics.kernel_cache import jitted
from procedures.restoration.masks.blur_models import SAMPLES

Array = NDArray[np.floating[Any]]

TAIL = 5.0
"""Widths of the line beyond which it has no light."""


@jitted(nogil=True)
def shares(x: Array, R: int, sigma: float) -> tuple[Array, Array]:
    """Light of each instant at x (T,) in each of 2R + 1 pixels, (T, 2R + 1), its line of width sigma pixels.

    And its whole light (T,), wherever it falls.
    """
    out, light = np.zeros((len(x), 2 * R + 1)), np.zeros(len(x))
    scale = 1 / (np.sqrt(2 * np.pi) * sigma * SAMPLES)
    for t in range(len(x)):
        first = int(np.ceil((x[t] - TAIL * sigma + R + 0.5) * SAMPLES - 0.5))
        last = int(np.floor((x[t] + TAIL * sigma + R + 0.5) * SAMPLES - 0.5))
        for k in range(first, last + 1):
            away = ((k + 0.5) / SAMPLES - R - 0.5 - x[t]) / sigma
            share = scale * np.exp(-away * away / 2)
            light[t] += share
            if 0 <= k < (2 * R + 1) * SAMPLES:
                out[t, k // SAMPLES] += share
    return out, light


@jitted(nogil=True)
def share_changes(x: Array, R: int, sigma: float) -> Array:
    """How the shares change with x, but for their wavering as a line passes from sample to sample."""
    out = np.zeros((len(x), 2 * R + 1))
    scale = 1 / (np.sqrt(2 * np.pi) * sigma)
    for t in range(len(x)):
        first = int(np.ceil(x[t] - TAIL * sigma + R + 0.5))
        last = int(np.floor(x[t] + TAIL * sigma + R + 0.5))
        for k in range(max(first, 0), min(last, 2 * R + 1) + 1):
            away = (k - R - 0.5 - x[t]) / sigma
            density = scale * np.exp(-away * away / 2)
            if k > 0:
                out[t, k - 1] -= density
            if k <= 2 * R:
                out[t, k] += density
    return out
