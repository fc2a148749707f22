"""Depth in metres from the blur of a restoration and the lens data, with uncertainties (chapter 9).

1 / l = 1 / l_s + r / (rho zeta), r the radius of the blur circle, positive in front of the plane of focus l_s. The
uncertainty due to r grows with the square of the distance; that due to the lens data is common to the frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.restoration.first_depth.initial_depth import LEVEL_PX, cost_volume, levels_of
from procedures.restoration.joint.result import Restoration
from procedures.restoration.masks.mask_fields import Masks
from procedures.restoration.masks.thin_lens import CameraSetting
from procedures.restoration.sampling_bias import without_bias

FRONT, BEHIND = "front", "behind"
UNDETERMINED_PX = 0.5
"""Standard deviation of w above which no distance is given: half a pixel, as in the restoration's verdict."""
MASKS_PX = 0.01
"""Standard uncertainty of w in addition to all others: masks are interpolated."""
MOVED, BIAS = 0.4, 1 / 3
"""Standard uncertainties of w relative to its change since the first depth, root mean square over a window of `NEAR`,
and to the correction of its bias. Chosen on twelve scenes of two renderers, with nineteen others to check."""
NEAR, LEAST_NEAR = 31, 0.4
"""Side of a window, pixels, of which that fraction must have a distance: small islands amid places that picture and
depth do not explain belong to the wrong surface."""
SURFACE = 15
"""Side of the window over which a surface is displaced, pixels: with 9 the uncertainty of places with little texture
was 2 to 5 times the error, with 27 it ignored errors of whole surfaces."""
BAND = 64
WINDOW = 9
"""Side of the window in which the residual is averaged, pixels."""
MAX_RESIDUAL = 1.3
"""Local residual over noise, root mean square, above which no distance is given: at depth edges, where pixels are
assigned to the wrong side, it is 2 to 5, elsewhere 0.4 to 1.3."""


@dataclass(frozen=True)
class CameraUncertainty:
    """Relative standard uncertainties of the camera's settings.

    focus : of the distance of focus; scale : of focal length over f-number and pixel pitch. A nominal f-number is
    within 1 % of its power of the root of 2; cameras record the focus distance in steps.
    """

    focus: float = 0.01
    scale: float = 0.01


@dataclass(frozen=True, eq=False)
class Distances:
    """Distance from the lens's front principal plane (H, W), and its standard uncertainty; metres, NaN if undetermined.

    common : (H, W)
        The part of the uncertainty that is common to the frame, from the lens data.
    side : input
    """

    metres: Array
    std: Array
    common: Array
    side: str

    @property
    def determined(self) -> float:
        """Fraction of the frame with a distance."""
        return float(np.isfinite(self.metres).mean())


def ambiguity(photographs: Sequence[Array], masks: Sequence[Masks], w: Array, noise: float) -> Array:
    """Standard deviation of w (H, W) over all displacements of its surface that the photographs near it allow.

    The least standard deviation of a restoration is local at its w, and ignores other w that fit as well. Here the cost
    of each displacement, squares of whitened differences (8.1) over a window, defines its likelihood; where none fits,
    as at depth edges, the smallest cost is taken as typical. Displacements are relative to w, so that the window may be
    as wide as the prior on w reaches, across slopes.

    photographs : (C, H, W) each, registered; noise : their standard deviation.
    """
    z, levels = np.stack([np.asarray(photograph, np.float64) for photograph in photographs]), levels_of(masks)
    cost = cost_volume(z, masks, np.full(len(z), max(noise, 1e-5)), levels, 1)
    terms = z.shape[1] * len(z) * (len(z) - 1) / 2
    variance, margin = np.empty(w.shape), SURFACE // 2
    for top in range(0, len(w), BAND):  # in bands: a second volume of a large photograph would not fit into memory
        first, last = max(top - margin, 0), min(top + BAND + margin, len(w))
        inside = slice(top - first, top - first + min(BAND, len(w) - top))
        variance[top : top + BAND] = _variance(cost[first:last], (w[first:last] - levels[0]) / LEVEL_PX, terms, inside)
    return np.asarray(LEVEL_PX * np.sqrt(variance))


def _variance(cost: NDArray[np.float32], at: Array, terms: float, rows: slice) -> Array:
    """Variance of the displacement from the level `at`, in levels, for some rows of costs (H, W, L)."""
    count = cost.shape[2]
    displaced, means = np.arange(1 - count, count), []
    for n in displaced:
        level = np.clip(at + n, 0, count - 1)
        below = np.minimum(level.astype(np.intp), count - 2)[..., None]
        low, high = (np.take_along_axis(cost, below + k, axis=2)[..., 0] for k in (0, 1))
        means.append(uniform_filter(low + (level - below[..., 0]) * (high - low), SURFACE)[rows])
    mean, end = np.stack(means, axis=-1) / terms, at[rows][..., None] + displaced
    least = mean.min(axis=-1, keepdims=True)
    likely = np.exp(-0.5 * terms * SURFACE**2 * (mean - least) / np.maximum(least, 1.0))
    likely = np.where((end < -0.5) | (end > count - 0.5), 0.0, likely) + (displaced == 0) * 1e-9
    return np.asarray(np.sum(likely * displaced**2, axis=-1) / np.sum(likely, axis=-1))


def unexplained(residual: Array, noise: float) -> NDArray[np.bool_]:
    """Where picture and depth do not explain the photographs (H, W), from the residual (P, C, H, W)."""
    power = uniform_filter(np.mean(residual.astype(np.float64) ** 2, axis=(0, 1)), WINDOW)
    return np.asarray(np.sqrt(power) > MAX_RESIDUAL * noise)


def depth_spread(
    restored: Restoration, photographs: Sequence[Array], masks: Sequence[Masks], shape: Array,
    sizes: Sequence[tuple[float, float]],
) -> tuple[Array, Array]:  # fmt: skip
    """w (H, W) without the masks' bias, and its standard deviation, infinite where picture and depth do not explain the
    photographs (C, H, W); shape, sizes : of the blur, see `without_bias`."""
    noise = restored.diagnostics.noise
    w, first, local = (np.asarray(one, np.float64) for one in (restored.w, restored.start.w, restored.w_std))
    corrected, slope = without_bias(w, shape, sizes, masks, restored.sharp)
    moved = MOVED**2 * uniform_filter((first - w) ** 2, NEAR)
    spread = slope * np.sqrt(local**2 + ambiguity(photographs, masks, w, noise) ** 2 + moved)
    spread = np.hypot(spread, BIAS * (corrected - w))
    known = ~unexplained(restored.residual.astype(np.float64), noise) & (spread <= UNDETERMINED_PX)
    alone = uniform_filter(known.astype(np.float64), NEAR) < LEAST_NEAR
    return np.asarray(corrected, np.float64), np.where(known & ~alone, spread, np.inf)


def distances_of(
    w: Array, w_std: Array, setting: CameraSetting, side: str, uncertainty: CameraUncertainty | None = None
) -> Distances:
    """Distances from w (H, W), the first photograph's blur radius, and its uncertainty; side : "front" or "behind" the
    plane of focus. Raises BadParameter for others, or behind infinity."""
    uncertainty = uncertainty or CameraUncertainty()
    if side not in (FRONT, BEHIND):
        raise BadParameter(f"the scene lies in {FRONT} of the plane of focus or {BEHIND}; got {side!r}", "give one")
    if side == BEHIND and not np.isfinite(setting.focus_mm):
        raise BadParameter("nothing lies behind a plane of focus at infinity", "give front")
    radius = np.asarray(w, np.float64) * (1 if side == FRONT else -1)
    inverse = radius / setting.scale_px_mm + 1 / setting.focus_mm
    local = np.hypot(w_std, MASKS_PX) / setting.scale_px_mm
    common = np.hypot(uncertainty.scale * radius / setting.scale_px_mm, uncertainty.focus / setting.focus_mm)
    std = np.hypot(local, common)
    # an inverse distance consistent with zero gives no distance
    determined = (np.asarray(w_std) <= UNDETERMINED_PX) & (inverse > 2 * std)
    metres = np.where(determined, 1e-3 / np.where(determined, inverse, 1.0), np.nan)
    of_distance = 1e3 * metres**2
    return Distances(metres, of_distance * std, of_distance * common, side)
