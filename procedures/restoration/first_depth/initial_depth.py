"""First depth map from the photographs alone, assuming uniform blur around each pixel.

Algorithm II (chapter 7) for symmetric blurs, Algorithm III (8.1) for any, and the default: Algorithm III with whitened
differences and labels matched over the whole frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.fft import fftfreq, irfft2, next_fast_len, rfft2, rfftfreq
from scipy.ndimage import (
    convolve1d,
    distance_transform_edt,
    gaussian_filter,
    maximum_filter,
    median_filter,
    uniform_filter,
)

from procedures.numerics.compiled import jitted
from procedures.restoration.masks.array_loops import most_threads
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.masks.mask_fields import Masks, half_size_at, over_frame

F32 = NDArray[np.float32]

SECOND_DIFFERENCE = (1.0, -2.0, 1.0)
LOW_PASS, MEDIAN = 2.0, 11
"""Sigma of Algorithm II's low-pass filter, and side of its final median filter, pixels."""
LEAST_W = 0.3
"""Smallest w to try, pixels: below it depths are indistinguishable."""
FLOOR = 1e-3
"""Limits the amplification of frequencies that neither photograph passes."""

# Semi-global matching of the whitened costs, which are chi-squares near 1 per channel at the truth.
WINDOW, WIDENED = 5, 0.25
"""Side of the costs' mean, pixels, and fraction of the smaller reach by which it is widened for smaller masks."""
CAP, FITS = 4.0, 3.0
"""Cost at which a level is simply wrong, and cost up to which it explains the photographs."""
SMALL, LARGE = 1.0, 24.0
"""Penalties of a change by one level and by more."""
LEVEL_PX, SMOOTHED_PX = 0.15, 7
"""Step of the levels, and side of the final median, pixels."""
OUTLYING = 0.5
"""Per cent of the frame on each side that is excluded from the scene's range of depths."""
LEAST_SIGMA = 1.4e-3
"""Noise equivalent of the level differences of the matching's steps: below it the first costs carry no information."""


@dataclass(frozen=True)
class DepthStart:
    """A first depth: w (H, W) pixels, and where the photographs agree with it: not at depth edges, which Algorithms II
    and III do not mark."""

    w: Array
    trusted: NDArray[np.bool_]


def relative_blur(z1: Array, z2: Array, direction: str = "both") -> tuple[Array, Array]:
    """Numerator and denominator of the relative blur: 2 (z2 - z1) and the curvature of the mean (7.1, 7.4).

    Their ratio is the difference of the masks' variances, pixels squared, where the photographs are polynomials of
    third order. Both have to pass through the same low-pass filter: apply it to z1 and z2.

    direction : "both" for masks symmetric about axes and diagonals, "x" or "y" for one-dimensional even masks.
    """
    mean, axes = (z1 + z2) / 2, {"both": (-2, -1), "x": (-1,), "y": (-2,)}[direction]
    return 2 * (z2 - z1), sum((convolve1d(mean, SECOND_DIFFERENCE, axis) for axis in axes), np.zeros_like(mean))


def algorithm_2(
    z: Array, stacks: Sequence[Masks], sigma: float, *, window: float = 9.0, direction: str = "both",
) -> DepthStart:  # fmt: skip
    """Depth from symmetric blur: relative blur of two photographs, converted to w by their masks (chapter 7).

    Two differences from the published filters remove a bias of up to 0.9 pixel: one low-pass filter for numerator and
    curvature in place of two polynomial fits, and a conversion by the masks' transfer functions in place of their
    moments. Where no masks have the estimated blur, as at depth edges, w is taken from the nearest valid place.

    z : (2, C, H, W) photographs.
    sigma : standard deviation of their noise.
    window : sigma of the window over which the ratio is a least-squares fit, pixels.
    direction : as for `relative_blur`.
    """
    smooth = gaussian_filter(np.asarray(z[:2], dtype=np.float64), (0, 0, LOW_PASS, LOW_PASS))
    numerator, curvature = relative_blur(smooth[0], smooth[1], direction)
    product, power = (gaussian_filter(a.sum(axis=0), window) for a in (numerator * curvature, curvature**2))
    impulse = gaussian_filter(np.pad(np.ones((1, 1)), round(5 * LOW_PASS)), LOW_PASS)
    response = relative_blur(impulse, impulse, direction)[1]
    noise = z.shape[1] * sigma**2 / 2 * float(np.sum(response**2))
    w = _width(product / np.maximum(power - noise, noise + 1e-20), stacks, direction)
    w = _from_nearest(w, round(window / 2))
    return DepthStart(np.asarray(median_filter(w, MEDIAN)), np.zeros(w.shape, bool))


@over_frame
def _width(ratio: Array, stacks: Sequence[MaskStack], direction: str) -> Array:
    """w at which two masks have a relative blur; NaN where none do."""
    expected = _expected_ratio(stacks, direction)
    sign = np.sign(expected[-1])
    # masks sampled at whole pixels change in steps with w; the blur of a scene does not
    levels = np.linspace(0, 1, len(expected))
    smooth = Polynomial.fit(levels, sign * expected, min(6, len(levels) - 1))(levels)
    relation = np.maximum.accumulate(smooth) + 1e-9 * np.arange(len(levels))
    w = np.interp(sign * ratio, relation, np.arange(len(relation)) * stacks[0].step)
    return np.asarray(np.where((sign * ratio > 0) & (sign * ratio <= relation[-1]), w, np.nan))


def _expected_ratio(stacks: Sequence[MaskStack], direction: str) -> Array:
    """Least-squares ratio of `relative_blur` at every level, for a scene with spectrum 1/f^2 as natural images have."""
    shape = (next_fast_len(4 * (2 * stacks[0].R + 1), True),) * 2
    wy, wx = 2 * np.pi * fftfreq(shape[0])[:, None], 2 * np.pi * rfftfreq(shape[1])[None, :]
    f2 = wy**2 + wx**2
    scene = np.exp(-f2 * LOW_PASS**2) / np.maximum(f2, f2[0, 1])
    scene[:, 1:-1] *= 2  # the half of the spectrum that rfft2 omits
    bend = {"both": 2 * np.cos(wy) + 2 * np.cos(wx) - 4, "x": 2 * np.cos(wx) - 2, "y": 2 * np.cos(wy) - 2}[direction]
    ratios = []
    for n in range(len(stacks[0].masks)):
        h1, h2 = (_spectra(s, n * s.step, shape) for s in stacks[:2])
        curvature = bend * (h1 + h2) / 2
        ratios.append(np.sum(scene * (2 * (h2 - h1) * curvature.conj()).real) / np.sum(scene * np.abs(curvature) ** 2))
    return np.array(ratios)


def _from_nearest(w: Array, clear: int) -> Array:
    """w (H, W) where it is at least `clear` pixels from unknown values; elsewhere that of the nearest such place."""
    unknown = np.isnan(w)
    near = maximum_filter(unknown, 2 * clear + 1)
    nearest = distance_transform_edt(unknown if near.all() else near, return_distances=False, return_indices=True)
    return np.asarray(np.nan_to_num(w[tuple(nearest)]))


def levels_of(stacks: Sequence[Masks], step: float = LEVEL_PX) -> Array:
    """Values of w to try, pixels."""
    return np.arange(LEAST_W, min(s.max_w for s in stacks) - 0.05, step)


def _spectra(stack: MaskStack, w: float, shape: tuple[int, int]) -> Array:
    k = np.zeros(shape)
    size = 2 * stack.R + 1
    k[:size, :size] = stack.at(w)
    return np.asarray(rfft2(np.roll(k, (-stack.R, -stack.R), (0, 1)), workers=most_threads()))


def _extended(z: Array, margin: int) -> tuple[Array, tuple[int, int]]:
    """Spectra of the reflected photographs, (P, C, ...), and the transform's shape."""
    H, W = z.shape[2:]
    shape = (next_fast_len(H + 2 * margin, True), next_fast_len(W + 2 * margin, True))
    pads = [(margin, shape[k] - (H, W)[k] - margin) for k in (0, 1)]
    return np.asarray(rfft2(np.pad(z, ((0, 0), (0, 0), *pads), mode="reflect"), workers=most_threads())), shape


@over_frame
def cost_volume(
    z: Array, stacks: Sequence[MaskStack], sigmas: Array, levels: Array, window: int, *, whiten: bool = True,
    even: float = 0.0,
) -> F32:  # fmt: skip
    """Cost of each level at each pixel, (H, W, L), summed over pairs of photographs and channels.

    Whitened, each difference z1 * h2 - z2 * h1 is divided by the root of its noise's spectrum
    sigma1^2 |H2|^2 + sigma2^2 |H1|^2, so that its mean square at the true level is 1 for any masks; otherwise the
    expected noise is subtracted as in (8.1). `even` widens the window of smaller masks by this fraction of their
    smaller reach: at a depth edge they would otherwise win because they do not reach it.
    """
    H, W = z.shape[2:]
    windows = _windows(stacks, levels, window, even)
    margin = 3 * stacks[0].R
    spectra, shape = _extended(z, margin)
    volume = np.zeros((H, W, len(levels)), np.float32)
    for n, w in enumerate(levels):
        masks = [_spectra(s, float(w), shape) for s in stacks]
        powers = [mask.real**2 + mask.imag**2 for mask in masks]
        for a, b in combinations(range(len(z)), 2):
            passed = sigmas[a] ** 2 * powers[b] + sigmas[b] ** 2 * powers[a]
            noise = passed + (sigmas[a] ** 2 + sigmas[b] ** 2) / 2 * FLOOR
            scale = np.sqrt(noise) if whiten else 1.0
            d = irfft2((spectra[a] * masks[b] - spectra[b] * masks[a]) / scale, shape, workers=most_threads())
            d = d[:, margin : margin + H, margin : margin + W]
            square = (d**2).sum(axis=0)
            if not whiten:
                norms = [float(np.sum(s.at(float(w)) ** 2)) for s in stacks]
                square -= len(d) * (sigmas[b] ** 2 * norms[a] + sigmas[a] ** 2 * norms[b])
            mean = uniform_filter(square, windows[n])
            volume[..., n] += mean if whiten else np.abs(mean)
    return volume


def _windows(stacks: Sequence[MaskStack], levels: Array, window: int, even: float) -> list[int]:
    reach = [sum(half_size_at(stack, float(w)) for stack in stacks) for w in levels]
    return [window + 2 * round(even * (reach[-1] - r) / 2) for r in reach]


def least_level(cost: Array, levels: Array) -> Array:
    """w of minimal cost at every pixel, refined by a parabola through its neighbours."""
    k = np.clip(cost.argmin(axis=2), 1, cost.shape[2] - 2)[..., None]
    a, b, c = (np.take_along_axis(cost, k + d, axis=2)[..., 0].astype(np.float64) for d in (-1, 0, 1))
    bend = a - 2 * b + c
    shift = np.where(bend > 0, (a - c) / (2 * np.where(bend > 0, bend, 1)), 0).clip(-0.5, 0.5)
    return np.asarray(levels[k[..., 0]] + shift * (levels[1] - levels[0]))


def algorithm_3(z: Array, stacks: Sequence[Masks], sigmas: Array) -> DepthStart:
    """Depth from blur (8.1): minimal noise-compensated difference over the levels, then a median."""
    levels = levels_of(stacks)
    cost = cost_volume(z, stacks, sigmas, levels, 9, whiten=False)
    w = np.asarray(median_filter(levels[cost.argmin(axis=2)], 13))
    return DepthStart(w, np.zeros(w.shape, bool))


def matched(z: Array, stacks: Sequence[Masks], sigmas: Array) -> DepthStart:
    """The default initial depth: whitened Algorithm III, matched over the frame, with less weight near its border,
    where light enters."""
    # over the scene's range only: how a level's window and cost compare with others' depends on the largest
    rough = _matched_at(z, stacks, sigmas, levels_of(stacks, 2 * LEVEL_PX)).w
    levels = levels_of(stacks)
    low, high = np.percentile(rough, (OUTLYING, 100 - OUTLYING))
    levels = levels[(levels > low - 4 * LEVEL_PX) & (levels < high + 4 * LEVEL_PX)]
    return _matched_at(z, stacks, sigmas, levels)


def _matched_at(z: Array, stacks: Sequence[Masks], sigmas: Array, levels: Array) -> DepthStart:
    volume = cost_volume(z, stacks, sigmas, levels, WINDOW, even=WIDENED)
    volume /= z.shape[1] * len(z) * (len(z) - 1) // 2
    # in place: cap (1 - exp(-cost / cap))
    volume /= -CAP
    np.expm1(volume, out=volume)
    volume *= -CAP
    volume *= (inside := _inside(z.shape[2:], stacks[0].R))[..., None]
    w = np.asarray(median_filter(least_level(semi_global(volume, SMALL, LARGE), levels), SMOOTHED_PX))
    nearest = np.clip(np.rint((w - levels[0]) / (levels[1] - levels[0])), 0, len(levels) - 1).astype(np.int64)
    cost = np.take_along_axis(volume, nearest[..., None], axis=2)[..., 0] / inside
    return DepthStart(w, cost < CAP * (1 - np.exp(-FITS / CAP)))


def _inside(shape: tuple[int, ...], R: int) -> F32:
    """1 farther than R from the border, falling towards it."""
    y, x = (np.minimum(np.arange(n), np.arange(n)[::-1]) for n in shape)
    return np.clip((np.minimum(y[:, None], x[None, :]) + 1) / R, 0.05, 1).astype(np.float32)


# --- semi-global matching (Hirschmueller 2008) -----------------------------------------------------------------------


@jitted(fastmath=True)
def _along(cost: NDArray[np.float32], total: NDArray[np.float32], dy: int, dx: int, small: float, large: float) -> None:
    """Add to `total` the cost of the best path that arrives along (dy, dx)."""
    height, width, labels = cost.shape
    before = np.zeros((width, labels), np.float32)
    now = np.zeros((width, labels), np.float32)
    for n in range(height):
        y = n if dy >= 0 else height - 1 - n
        for m in range(width):
            x = m if dx >= 0 else width - 1 - m
            here = cost[y, x]
            path = now[x]
            px, py = x - dx, y - dy
            if px < 0 or px >= width or py < 0 or py >= height:
                for k in range(labels):
                    path[k] = here[k]
            else:
                came = now[px] if dy == 0 else before[px]
                least = came[0]
                for k in range(1, labels):
                    least = min(least, came[k])
                for k in range(labels):
                    best = min(came[k], least + large)
                    if k > 0:
                        best = min(best, came[k - 1] + small)
                    if k < labels - 1:
                        best = min(best, came[k + 1] + small)
                    path[k] = here[k] + best - least
            for k in range(labels):
                total[y, x, k] += path[k]
        before, now = now, before


DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


def semi_global(cost: NDArray[np.float32], small: float, large: float) -> NDArray[np.float32]:
    """Cost volume (H, W, L) aggregated along straight paths; penalties of a change by one label (small), by more
    (large)."""
    total = np.zeros_like(cost)
    for dy, dx in DIRECTIONS:
        _along(cost, total, dy, dx, small, large)
    return total
