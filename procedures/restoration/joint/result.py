"""What a restoration gives: picture, depth, and what it says of itself."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from procedures.outcome import Outcome
from procedures.restoration.first_depth import initial_depth
from procedures.restoration.joint import joint_descent
from procedures.restoration.joint.moved_objects import Mask
from procedures.restoration.masks.blur_models import DepthUnit
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import MaskField, Masks


@dataclass(frozen=True)
class RestorationDiagnostics:
    """What a restoration says of itself.

    noise : standard deviation, white = 1; residual_over_noise : root mean square of what is left over, over the
    photographs' own noise as `noise_seen` tells it; unexplained : what is left over beyond that
    noise, over the photographs' contrast, the measure of how far masks and photographs disagree; picture_std : expected
    error of the sharp picture, white = 1, and gained : what blur took from the least blurred photograph, over that, see
    `picture_error`; undetermined : part of the frame whose w is uncertain by more than half a pixel at best;
    noise_gain : of the restoration at the median w; saturated, at_limit, moved, occlusion : parts of the frame
    saturated, at the end of the range of w, in which something moved, and beside steps of depth; elsewhere_over_noise :
    without what moved, over the noise that the photographs' finest detail shows.
    """

    noise: float
    residual_over_noise: float
    unexplained: float
    picture_std: float
    gained: float
    undetermined: float
    noise_gain: float
    saturated: float
    at_limit: float
    moved: float
    occlusion: float
    elsewhere_over_noise: float


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """What a ground truth says of a restoration; white = 1.

    Attributes
    ----------
    psnr_db : float
        Of the restored picture, noise of the ground truth included.
    before_db : tuple of float
        Of each photograph as it came, held against the ground truth in the same way; NaN where it cannot be laid on.
    error, told : float
        Root mean square difference without the ground truth's noise, and what the restoration tells of the same pixels.
    softer_px : float
        The ground truth is as sharp as the restored picture blurred by a Gaussian of that standard deviation, pixels:
        a small aperture's diffraction, for one.
    error_as_soft : float
        The error of the picture blurred so.
    noise : float
        Of the ground truth, at most.
    seen : float
        Part of the frame that was compared.
    light : float
        The ground truth's over the restored picture's.
    matrix : (2, 3) float64
        Place of a pixel of the restored picture in the ground truth.
    difference : (C, H, W) float32
        The restored picture less the ground truth; NaN where it shows nothing.
    """

    psnr_db: float
    before_db: tuple[float, ...]
    error: float
    told: float
    softer_px: float
    error_as_soft: float
    noise: float
    seen: float
    light: float
    matrix: Array
    difference: NDArray[np.float32]


@dataclass(frozen=True)
class Restoration:
    """Sharp picture (C, H, W), w (H, W) pixels and its least standard deviation, residuals (P, C, H, W), history.

    sharp_std : (H, W) expected error of the picture's planes, white = 1, see `error_map`.
    shifts : (P, 2) x, y of each photograph against the first beyond what its masks contain, pixels; light : (P,) over
    the first's; turns, zooms : (P,) against the first, radians and over its size; all taken up. moved : (H, W), where
    something moved between the photographs: neither picture nor w is to be believed there. occlusion : (H, W), beside
    steps of depth, where w may be either side's and both errors are raised, see `occlusion`.
    unit : what w is told in to people and files. kernels : (P, K, K) of a flat scene's motions that were found, one
    sample a pixel, or None; shapes : (P, n, n) on [-1, 1] of those of a scene in depth, or None. ground_truth : what
    such a photograph says of it, where there was one.
    """

    sharp: Array
    sharp_std: Array
    w: Array
    w_std: Array
    residual: Array
    start: initial_depth.DepthStart
    history: tuple[joint_descent.JointRound, ...]
    diagnostics: RestorationDiagnostics
    shifts: Array
    light: Array
    turns: Array
    zooms: Array
    moved: Mask
    occlusion: Mask
    unit: DepthUnit = field(default_factory=DepthUnit)
    kernels: Array | None = None
    shapes: Array | None = None
    ground_truth: GroundTruth | None = None

    def uncertain_by(self, more: Array) -> Restoration:
        """The same with another error (H, W) of the picture beside those that its diagnostics know."""
        d, square = self.diagnostics, float(np.mean(more**2))
        std = float(np.hypot(d.picture_std, square**0.5))
        told = replace(d, picture_std=std, gained=d.gained * d.picture_std / max(std, 1e-9))
        return replace(self, sharp_std=np.hypot(self.sharp_std, more), diagnostics=told)


def told_in(
    unit: DepthUnit, outcome: Outcome[Restoration], kernels: Array | None = None, shapes: Array | None = None
) -> Outcome[Restoration]:
    """The same, with w told in that unit, and the kernels or shapes that were found."""
    if outcome.value is None:
        return outcome
    return replace(outcome, value=replace(outcome.value, unit=unit, kernels=kernels, shapes=shapes))


def refocused(result: Restoration, stack: Masks, focus_w: float, strength: float = 1.0) -> Array:
    """The sharp picture with another depth of focus, (C, H, W): sharp at w = `focus_w`, blurred by distance from it."""
    R = stack.R
    blur = MaskField.of(stack).blur((result.w.shape[0], result.w.shape[1]), np.float64)
    blur.focus(np.pad(np.abs(result.w - focus_w) * strength, R, mode="edge"))
    return blur.blur(np.pad(result.sharp, ((0, 0), (R, R), (R, R)), mode="edge").astype(np.float64))
