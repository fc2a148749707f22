"""Depth steps put in their place: two layers meet somewhere in a band, and the photographs say where.

Along a step, windowed matching is wrong by several pixels and descent on w never moves the step: in between lie depths
that fit nothing. So each side's depth is continued across the band, and the picture is shared between the two layers by
b in [0, 1]: z = (b u) *v h(high) + ((1 - b) u) *v h(low). That is linear in b however far the two depths are apart;
Gauss-Newton over (u, b) finds the border, and b > 1/2 is the new labelling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter, maximum_filter, median_filter, minimum_filter

from procedures.restoration.cost import DataTerm, conjugate_gradients, restored_change
from procedures.restoration.forward import Array
from procedures.restoration.newton import PICTURE_CURVATURE
from procedures.restoration.priors import diffuse

SHARE_CURVATURE = 0.05
SHARE_WEIGHT = 1e-3


@dataclass(frozen=True)
class Layers:
    """Depth of both layers and where they compete: high, low (H', W'), band bool, share of the high layer."""

    high: Array
    low: Array
    band: NDArray[np.bool_]
    share: Array


def _span(w: Array, size: int) -> Array:
    return np.asarray(maximum_filter(w, size) - minimum_filter(w, size))


def continued(w: Array, known: Array, sigma: float) -> Array:
    """w continued from where `known` is 1: at each pixel, the plane that fits the known depths around it best.

    Gaussian window of `sigma` pixels; the slope is damped, so far from any known depth it is a mean.
    """

    def mean(a: Array) -> Array:
        return np.asarray(gaussian_filter(a, sigma, truncate=3.5, mode="nearest"))

    y, x = np.indices(w.shape).astype(w.dtype)
    m = mean(known) + 1e-12
    mx, my, mw = mean(known * x) / m, mean(known * y) / m, mean(known * w) / m
    xx = mean(known * x * x) / m - mx**2 + sigma / 4
    yy = mean(known * y * y) / m - my**2 + sigma / 4
    xy = mean(known * x * y) / m - mx * my
    xw, yw = mean(known * x * w) / m - mx * mw, mean(known * y * w) / m - my * mw
    det = xx * yy - xy**2
    return np.asarray(mw + (yy * xw - xy * yw) / det * (x - mx) + (xx * yw - xy * xw) / det * (y - my))


def _upper_side(w: Array, jumps: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each pixel lies on the upper side of the jump nearest to it.

    Decided beside the jump and carried outwards, as farther out the lower side may have risen above the upper one.
    """
    beside = maximum_filter(jumps, 5) & ~jumps
    middle = (maximum_filter(w, 7) + minimum_filter(w, 7)) / 2
    nearest = distance_transform_edt(~beside, return_distances=False, return_indices=True)
    return np.asarray((w > middle)[tuple(nearest)])


def layers_afar(w: Array, reach: int, jump: float) -> Layers:
    """Layers of a rough depth map: nothing within `reach` of a jump is believed but its two sides farther out."""
    w = w.astype(np.float64)
    jumps = _span(w, 3) > jump
    if not jumps.any():
        return _no_layers(w)
    up = _upper_side(w, jumps)
    far = ~maximum_filter(jumps, 2 * reach - 3)
    wide = 4 * reach + 1
    highest, lowest = maximum_filter(w, wide), minimum_filter(w, wide)
    high = np.clip(continued(w, (far & up).astype(float), 0.8 * reach), lowest, highest + jump)
    low = np.clip(continued(w, (far & ~up).astype(float), 0.8 * reach), lowest - jump, highest)
    band = maximum_filter(jumps, 2 * reach - 1) & (high - low > jump / 2)
    # undecided where the rough map decided wrongly: a share that begins at 0 or 1 is slow to leave it
    share = gaussian_filter(up.astype(float), reach / 3)
    return Layers(np.where(band, high, w), np.where(band, low, w), band, np.where(band, share, 0.0))


def layers_near(w: Array, reach: int, jump: float) -> Layers:
    """Layers of a good depth map: each side keeps its depth up to the jump, the other side is continued over it."""
    w = w.astype(np.float64)
    jumps = _span(w, 3) > jump
    if not jumps.any():
        return _no_layers(w)
    wide = 2 * reach + 3
    up = w > (maximum_filter(w, wide) + minimum_filter(w, wide)) / 2
    sigma = 2 + reach / 3
    high = np.where(up & ~jumps, w, continued(w, (up & ~jumps).astype(float), sigma))
    low = np.where(~up & ~jumps, w, continued(w, (~up & ~jumps).astype(float), sigma))
    band = maximum_filter(jumps, 2 * reach + 1) & (high - low > jump / 2)
    share = gaussian_filter(up.astype(float), 1.0)
    return Layers(np.where(band, high, w), np.where(band, low, w), band, np.where(band, share, 0.0))


def _no_layers(w: Array) -> Layers:
    return Layers(w, w, np.zeros(w.shape, bool), np.zeros_like(w))


def shared(
    high: DataTerm, low: DataTerm, u: Array, layers: Layers, weight: float, rounds: int, iterations: int
) -> tuple[Array, Array]:
    """Picture (C, H', W') and share (H', W') that explain the photographs best, by Gauss-Newton over both.

    high, low : the same data term, to be focused on each layer; weight : of the picture's prior. Only the band and its
    surroundings change.
    """
    band, b = layers.band.astype(u.dtype), layers.share.astype(u.dtype)
    around = surroundings(layers.band, high.R)
    for _ in range(rounds):
        e = _unexplained(high, low, u, layers, b)
        x = _share_step(high, low, (u, b, band, around.astype(u.dtype)), e, weight, iterations)
        b = np.where(layers.band, np.clip(b + np.clip(x[-1], -0.3, 0.3), 0, 1), 0).astype(u.dtype)
        u = u + x[:-1]
    return u, b


def surroundings(band: NDArray[np.bool_], R: int) -> NDArray[np.bool_]:
    """The pixels whose light can mix with the band's."""
    return np.asarray(maximum_filter(band, 4 * R + 1))


def _unexplained(high: DataTerm, low: DataTerm, u: Array, layers: Layers, b: Array) -> Array:
    """Photographs minus both layers; leaves the terms focused on the band's surroundings."""
    around = surroundings(layers.band, high.R)
    above, below = layers.high.astype(u.dtype), layers.low.astype(u.dtype)
    low.focus(below)
    high.focus(above, layers.band)
    e = high.z * high.trust - high.blur(u * b) - low.blur(u * (1 - b))
    high.focus(above, around)
    low.focus(below, around)
    return e


def _share_step(
    high: DataTerm, low: DataTerm, at: tuple[Array, Array, Array, Array], e: Array, weight: float, iterations: int
) -> Array:
    """Change of picture and share (C + 1, H', W') that the errors e ask for. at : u, share, band, surroundings."""
    u, b, band, around = at

    def smooth(v: Array, share: Array) -> Array:
        return np.concatenate([around * weight * diffuse(v), (SHARE_WEIGHT * band * diffuse(share * band))[None]])

    def gradients(e: Array) -> Array:
        above, below = high.blur_adjoint(e), low.blur_adjoint(e)
        return np.concatenate([b * above + (1 - b) * below, (band * (u * (above - below)).sum(axis=0))[None]])

    def apply(x: Array) -> Array:
        du, db = x[:-1], x[-1] * band
        return gradients(high.blur(du * b + u * db) + low.blur(du * (1 - b) - u * db)) + smooth(x[:-1], x[-1])

    divide = np.full((len(u) + 1, *b.shape), PICTURE_CURVATURE, u.dtype)
    divide[-1] = SHARE_CURVATURE * (u**2).sum(axis=0) + 4 * SHARE_WEIGHT
    return conjugate_gradients(apply, gradients(e) - smooth(u, b), iterations, divide)


def place_steps(
    high: DataTerm,
    low: DataTerm,
    u: Array,
    w: Array,
    layers: Layers,
    weight: float,
    rounds: int = 6,
    iterations: int = 10,
) -> tuple[Array, Array]:
    """Picture and depth with the steps moved where that explains the photographs better, and left elsewhere.

    Both labellings restore their own picture first; each neighbourhood then keeps the one with less residual.
    """
    if not layers.band.any():
        return u, w
    sharper, b = shared(high, low, u, layers, weight, rounds, iterations)
    border = median_filter(b, 3) > 0.5
    moved = np.where(layers.band, np.where(border, layers.high, layers.low), w).astype(w.dtype)
    around = surroundings(layers.band, high.R)
    before, wrong_before = _explained(high, u, w, weight, iterations, around)
    after, wrong_after = _explained(high, sharper, moved, weight, iterations, around)
    window = 2 * high.R + 1
    better = gaussian_filter(wrong_before - wrong_after, window / 3) > 0
    return np.where(better, after, before), np.where(better, moved, w)


def _explained(
    data: DataTerm, u: Array, w: Array, weight: float, iterations: int, around: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """The picture restored at w around the band, and the squared residual of every pixel on the extended grid."""
    data.focus(w)
    e = data.residual(u)
    data.focus(w, around)
    u = u + restored_change(data, u, e, weight, iterations, around.astype(u.dtype))
    data.focus(w)
    return u, np.pad((data.residual(u) ** 2).sum(axis=(0, 1)), data.R)
