"""Bias of w by masks that are sums over pixels, predicted from the shape of the blur.

A restored picture holds the blur of a pixel already. Masks summed over pixels add it once more, and a blur circle
within a pixel becomes a point. The bias of w hardly depends on the picture: it is that of the masks whose relative
blur, as in (8.1), agrees best with that of the shape's own transfer functions.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from procedures.restoration.first_depth.initial_depth import FLOOR, LEAST_W, least_level
from procedures.restoration.joint.noise_and_contrast import band_powers, rings_of
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import Masks

FREQUENCIES, STEP = 24, 0.1
"""Frequencies along each axis, and step of w, pixels: with twice as many or half of it, the bias changes by 0.01."""
SLOPE = (0.5, 3.0)
"""Limits of the change of the corrected w with w: between them, steps of the masks are noticed."""


def without_bias(
    w: Array, shape: Array, sizes: Sequence[tuple[float, float]], masks: Sequence[Masks], picture: Array
) -> tuple[Array, Array]:
    """w without the bias of the masks, and the change of it with w; both (H, W).

    w : (H, W) pixels; shape : of every photograph's blur, on [-1, 1]; sizes : ratio and offset of its half-width;
    picture : (C, H, W), weighs the frequencies. Where no blur would give so small a w, it is left unchanged.
    """
    fitted, true = _agreeing_levels(shape, sizes, masks, picture)
    rising = np.maximum.accumulate(fitted) + 1e-6 * np.arange(len(fitted))
    low, here, high = (at + np.interp(at, rising, true - rising) for at in (w - STEP / 2, w, w + STEP / 2))
    determined = w > rising[0]
    return np.where(determined, here, w), np.where(determined, np.clip((high - low) / STEP, *SLOPE), 1.0)


def _agreeing_levels(
    shape: Array, sizes: Sequence[tuple[float, float]], masks: Sequence[Masks], picture: Array
) -> tuple[Array, Array]:
    """w of the masks that agree best with blur of the shape, and its w, (n,) each."""
    levels = np.arange(LEAST_W, min(one.max_w for one in masks), STEP)
    unit = np.linspace(-1, 1, len(shape))
    exact = [np.stack([_transfer(shape, (a * w + b) * unit) for w in levels]) for a, b in sizes]
    summed = [np.stack([_transfer(one.at(w), np.arange(-one.R, one.R + 1.0)) for w in levels]) for one in masks]
    rings = rings_of((FREQUENCIES, FREQUENCIES))[:, : FREQUENCIES // 2]
    power = np.where(rings < 0, 0.0, band_powers(picture.astype(np.float64))[rings]).ravel()
    cost = np.zeros((len(levels), len(levels)))
    for a, b in combinations(range(len(masks)), 2):  # |exact_a summed_b - exact_b summed_a|^2, whitened
        weight = power / (np.abs(summed[a]) ** 2 + np.abs(summed[b]) ** 2 + FLOOR)
        for one, other in ((a, b), (b, a)):
            cost += np.abs(exact[one]) ** 2 @ (weight * np.abs(summed[other]) ** 2).T
        cost -= 2 * ((exact[a] * exact[b].conj()) @ (weight * summed[b] * summed[a].conj()).T).real
    return least_level(cost[None], levels)[0], levels


def _transfer(image: Array, places: Array) -> NDArray[np.complex128]:
    """Transfer function of a square image, its samples at `places` along each axis, over half of the frequencies."""
    waves = np.exp(-2j * np.pi * np.outer(np.fft.fftfreq(FREQUENCIES), places))
    return np.asarray(waves @ image @ waves[: FREQUENCIES // 2].T / image.sum()).ravel()
