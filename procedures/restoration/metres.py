"""Depth in metres from the blur of a restoration and the lens data, with uncertainties (chapter 9).

1 / l = 1 / l_s + r / (rho zeta), r the radius of the blur circle, positive in front of the plane of focus l_s. The
uncertainty due to r grows with the square of the distance; that due to the lens data is common to the frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.restoration.first_depth.initial_depth import cost_volume, levels_of
from procedures.restoration.masks.mask_fields import Masks
from procedures.restoration.masks.thin_lens import CameraSetting

FRONT, BEHIND = "front", "behind"
UNDETERMINED_PX = 0.5
"""Standard deviation of w above which no distance is given: half a pixel, as in the restoration's verdict."""
MASKS_PX = 0.03
"""Standard uncertainty of w in addition to noise: masks are interpolated, and windows extend across slopes."""
WINDOW = 9
"""Side of the window in which photographs are compared for every w, pixels."""
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
    setting, side : input
    """

    metres: Array
    std: Array
    common: Array
    setting: CameraSetting
    side: str

    @property
    def determined(self) -> float:
        """Fraction of the frame with a distance."""
        return float(np.isfinite(self.metres).mean())


def ambiguity(photographs: Sequence[Array], masks: Sequence[Masks], w: Array, noise: float) -> Array:
    """Standard deviation of w (H, W) over all values consistent with the photographs near each pixel.

    The least standard deviation of a restoration is local at its w, and ignores other w that fit as well. Here the cost
    of each level, squares of whitened differences (8.1) over a window, defines its likelihood; where none fits, as at
    depth edges, the smallest cost is taken as typical.

    photographs : (C, H, W) each, registered; noise : their standard deviation.
    """
    z, levels = np.stack([np.asarray(one, np.float64) for one in photographs]), levels_of(masks)
    cost = cost_volume(z, masks, np.full(len(z), max(noise, 1e-5)), levels, WINDOW)
    terms = z.shape[1] * len(z) * (len(z) - 1) / 2
    variance = np.empty(w.shape)
    for y, row in enumerate(cost):  # row by row: a second volume of a large photograph would not fit into memory
        mean = row.astype(np.float64) / terms
        least = mean.min(axis=1, keepdims=True)
        likely = np.exp(-0.5 * terms * WINDOW**2 * (mean - least) / np.maximum(least, 1.0))
        variance[y] = np.sum(likely * (levels - w[y][:, None]) ** 2, axis=1) / np.sum(likely, axis=1)
    return np.sqrt(variance)


def unexplained(residual: Array, noise: float) -> NDArray[np.bool_]:
    """Where picture and depth do not explain the photographs (H, W), from the residual (P, C, H, W)."""
    power = uniform_filter(np.mean(residual.astype(np.float64) ** 2, axis=(0, 1)), WINDOW)
    return np.asarray(np.sqrt(power) > MAX_RESIDUAL * noise)


def distances_of(
    w: Array, w_std: Array, setting: CameraSetting, side: str, uncertainty: CameraUncertainty | None = None
) -> Distances:
    """Distances from w (H, W), the radius of the first photograph's blur circle in pixels, and its uncertainty.

    setting : of the first photograph; side : "front" or "behind": position of the scene relative to the plane of focus.
    Raises BadParameter if the side is unknown, or the scene is behind a plane of focus at infinity.
    """
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
    return Distances(metres, of_distance * std, of_distance * common, setting, side)
