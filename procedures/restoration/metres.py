"""Depth in metres from the blur that a restoration found, by the lens's numbers and what is known of them (chapter 9).

1 / l = 1 / l_s + r / (rho zeta), r the radius of the blur circle, positive in front of the plane of focus l_s. What is
uncertain of r counts with the square of the distance; what is uncertain of the lens's numbers is alike over the frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from procedures.outcome import BadParameter
from procedures.restoration.first_depth.initial_depth import cost_volume, levels_of
from procedures.restoration.masks.mask_fields import Masks
from procedures.restoration.masks.thin_lens import CameraSetting

Array = NDArray[np.float64]

FRONT, BEHIND = "front", "behind"
UNDETERMINED_PX = 0.5
"""Standard deviation of w from which no distance is told: half a pixel, as in the restoration's verdict."""
MASKS_PX = 0.03
"""Standard uncertainty of w beside that of noise: masks are interpolated, and windows lie across slopes."""
WINDOW = 9
"""Pixels along each side over which photographs are held against every w."""
MOST_LEFT = 1.3
"""Residual about a pixel over the noise, root mean square, from which no distance is told: beside steps of depth, where
the restoration gave a pixel to the wrong side, it is 2 to 5, elsewhere 0.4 to 1.3."""
LEAST_W = 0.3
"""Blur of which nothing is told apart."""


@dataclass(frozen=True)
class Knowledge:
    """Relative standard uncertainties of what the camera is said to be set to.

    focus : of the distance of focus; scale : of focal length over f-number and pixel pitch. A nominal f-number is
    within 1 % of the power of the root of 2 that it stands for; a focus distance that cameras note comes in steps.
    """

    focus: float = 0.01
    scale: float = 0.01


@dataclass(frozen=True, eq=False)
class Distances:
    """Distance from the lens's front principal plane (H, W), and its standard uncertainty; metres, NaN where not told.

    common : (H, W)
        The part of the uncertainty that is alike over the frame: of the lens's numbers.
    setting, side : what they were told from
    """

    metres: Array
    std: Array
    common: Array
    setting: CameraSetting
    side: str

    @property
    def told(self) -> float:
        """Part of the frame whose distance is told."""
        return float(np.isfinite(self.metres).mean())


def ambiguity(photographs: Sequence[Array], masks: Sequence[Masks], w: Array, noise: float) -> Array:
    """Standard deviation of w (H, W) by all that the photographs allow about each pixel, far from what was found too.

    The least standard deviation of a restoration knows the slope at what was found, and no other w that fits as well.
    How wrong each level is, squares of whitened differences (8.1) over a window, gives each its likelihood; where none
    fits, as beside steps of depth, the least is taken for what is usual.

    Parameters
    ----------
    photographs : (C, H, W) each, of one registration; noise : their standard deviation
    """
    z, levels = np.stack([np.asarray(one, np.float64) for one in photographs]), levels_of(masks, LEAST_W)
    cost = cost_volume(z, masks, np.full(len(z), max(noise, 1e-5)), levels, WINDOW)
    terms = z.shape[1] * len(z) * (len(z) - 1) / 2
    variance = np.empty(w.shape)
    for y, row in enumerate(cost):  # row by row: a second volume of a large photograph would not fit beside the first
        mean = row.astype(np.float64) / terms
        least = mean.min(axis=1, keepdims=True)
        likely = np.exp(-0.5 * terms * WINDOW**2 * (mean - least) / np.maximum(least, 1.0))
        variance[y] = np.sum(likely * (levels - w[y][:, None]) ** 2, axis=1) / np.sum(likely, axis=1)
    return np.sqrt(variance)


def unexplained(residual: Array, noise: float) -> NDArray[np.bool_]:
    """Where picture and depth do not explain the photographs (H, W), from what they leave over, (P, C, H, W)."""
    power = uniform_filter(np.mean(residual.astype(np.float64) ** 2, axis=(0, 1)), WINDOW)
    return np.asarray(np.sqrt(power) > MOST_LEFT * noise)


def distances_of(
    w: Array, w_std: Array, setting: CameraSetting, side: str, known: Knowledge | None = None
) -> Distances:
    """Distances from w (H, W), the radius of the first photograph's blur circle in pixels, and its uncertainty.

    Parameters
    ----------
    setting : of the first photograph
    side : "front" or "behind": where the scene lies, seen from the plane of focus

    Raises
    ------
    BadParameter
        If the side is another word, or the plane of focus is at infinity and the scene behind it.
    """
    known = known or Knowledge()
    if side not in (FRONT, BEHIND):
        raise BadParameter(f"the scene lies in {FRONT} of the plane of focus or {BEHIND}; got {side!r}", "say which")
    if side == BEHIND and not np.isfinite(setting.focus_mm):
        raise BadParameter("nothing lies behind a plane of focus at infinity", "say that the scene lies in front of it")
    radius = np.asarray(w, np.float64) * (1 if side == FRONT else -1)
    inverse = radius / setting.scale_px_mm + 1 / setting.focus_mm
    own = np.hypot(w_std, MASKS_PX) / setting.scale_px_mm
    common = np.hypot(known.scale * radius / setting.scale_px_mm, known.focus / setting.focus_mm)
    std = np.hypot(own, common)
    # an inverse distance that may be zero is a distance that may be any
    told = (np.asarray(w_std) <= UNDETERMINED_PX) & (inverse > 2 * std)
    metres = np.where(told, 1e-3 / np.where(told, inverse, 1.0), np.nan)
    of_distance = 1e3 * metres**2
    return Distances(metres, of_distance * std, of_distance * common, setting, side)
