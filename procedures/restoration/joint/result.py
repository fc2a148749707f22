"""Result of a restoration: picture, depth and diagnostics."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from procedures.display import summary
from procedures.numerics.arrays import Mask
from procedures.outcome import Outcome
from procedures.restoration.first_depth import initial_depth
from procedures.restoration.joint import joint_descent
from procedures.restoration.masks.blur_models import DepthUnit
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import MaskField, Masks


@dataclass(frozen=True)
class RestorationDiagnostics:
    """Diagnostics of a restoration.

    noise : standard deviation, white = 1; residual_over_noise : root mean square residual over the photographs' noise
    as estimated by `residual_noise`; unexplained : residual in excess of that noise, relative to the photographs'
    contrast: the disagreement of masks and photographs; picture_std : expected error of the sharp picture, white = 1,
    and gained : error of the least blurred photograph relative to it, see `picture_error`; undetermined : fraction of
    the frame with w uncertain by more than half a pixel; noise_gain : of the restoration at the median w; saturated,
    at_limit, moved, occlusion : fractions of the frame saturated, at the end of the range of w, with motion, and next
    to depth edges; elsewhere_over_noise : residual without moved parts, relative to the noise at the photographs'
    highest frequencies; sharpened : largest score of an unsharp mask in the noise of a photograph's flat parts.
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
    sharpened: float = 0.0


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """Comparison of a restoration with a ground truth; white = 1.

    psnr_db : of the restored picture, noise of the ground truth included; before_db : of each photograph before
    restoration, NaN where it cannot be aligned. error, stated_error : root mean square difference without the ground
    truth's noise, and the restoration's estimate for the same pixels. softer_px : standard deviation of the Gaussian
    blur by which the ground truth is softer, for instance from the diffraction of a small aperture; error_as_soft :
    after this blur. noise : upper bound of the ground truth's; compared : fraction of the frame; light : of the ground
    truth relative to the restored picture. matrix : (2, 3), maps a pixel of the restored picture to the ground truth;
    difference : (C, H, W), the restored picture less the ground truth, NaN where they cannot be compared.
    """

    psnr_db: float
    before_db: tuple[float, ...]
    error: float
    stated_error: float
    softer_px: float
    error_as_soft: float
    noise: float
    compared: float
    light: float
    matrix: Array
    difference: NDArray[np.float32]


@dataclass(frozen=True)
class Restoration:
    """Sharp picture (C, H, W), w (H, W) pixels and its least standard deviation, residuals (P, C, H, W), history.

    sharp_std : (H, W) expected error of the picture's planes, white = 1, see `error_map`.
    shifts : (P, 2) x, y of each photograph relative to the first beyond its masks, pixels; light : (P,) relative to the
    first; turns, zooms : (P,) relative to the first, radians and ratio; all are corrected for. moved : (H, W), where
    something moved between the photographs and neither picture nor w is reliable. occlusion : (H, W), next to depth
    edges, where w may belong to either side and both errors are raised, see `occlusion`. budget : terms of the expected
    error of the picture, white = 1; brighter : that error with four times the light.
    unit : of w in files and reports. kernels : (P, K, K) of the estimated motions of a flat scene, one sample a pixel,
    or None; shapes : (P, n, n) on [-1, 1] of those of a scene in depth, or None. ground_truth : comparison with one, or
    None.
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
    budget: Mapping[str, float]
    brighter: float
    unit: DepthUnit = field(default_factory=DepthUnit)
    kernels: Array | None = None
    shapes: Array | None = None
    ground_truth: GroundTruth | None = None

    __repr__ = summary

    def with_added_error(self, term: str, more: Array) -> "Restoration":
        """With an additional error (H, W) of the picture, independent of that in the diagnostics: a term of its
        budget."""
        d, added = self.diagnostics, float(np.mean(more**2)) ** 0.5
        std = float(np.hypot(d.picture_std, added))
        diagnostics = replace(d, picture_std=std, gained=d.gained * d.picture_std / max(std, 1e-9))
        return replace(
            self, sharp_std=np.hypot(self.sharp_std, more), diagnostics=diagnostics,
            budget={**self.budget, term: added}, brighter=float(np.hypot(self.brighter, added)),
        )  # fmt: skip


def with_unit(
    unit: DepthUnit, outcome: Outcome[Restoration], kernels: Array | None = None, shapes: Array | None = None
) -> Outcome[Restoration]:
    """The restoration with the unit of w, and the estimated kernels or shapes."""
    if outcome.value is None:
        return outcome
    return replace(outcome, value=replace(outcome.value, unit=unit, kernels=kernels, shapes=shapes))


def refocused(result: Restoration, stack: Masks, focus_w: float, strength: float = 1.0) -> Array:
    """The sharp picture refocused, (C, H, W): sharp at w = `focus_w`, blurred in proportion to the distance from it."""
    R = stack.R
    blur = MaskField.of(stack).blur((result.w.shape[0], result.w.shape[1]), np.float64)
    blur.focus(np.pad(np.abs(result.w - focus_w) * strength, R, mode="edge"))
    return blur.blur(np.pad(result.sharp, ((0, 0), (R, R), (R, R)), mode="edge").astype(np.float64))
