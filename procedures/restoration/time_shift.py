"""One shift between the times of motion records and the photographs, fitted within what is known of the clocks.

Masks of the true motion explain the photographs down to their noise (8.1). A record whose times are late gives other
masks, and a larger residual. The shift is common to all photographs, as their records came by one cable.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from procedures.outcome import BadInput, Refused
from procedures.restoration.first_depth.initial_depth import WINDOW
from procedures.restoration.first_depth.registration import register
from procedures.restoration.joint.estimate import noise_of
from procedures.restoration.masks import checks
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import Masks

LEAST_S = 2e-4
"""Bound of the times' error below which nothing is fitted, and resolution of the fit."""
STEP_S = 0.003
"""Step of the search: a tenth of the shortest period, 30 ms, that a rig's motion commonly has."""
MOST_STEPS = 20
LEVEL_PX = 0.4
"""Step of the depths tried."""
SIDE_PX = 512
"""Side of the central part of the photographs that is used."""


@dataclass(frozen=True)
class TimeShift:
    """How late the records' times are, with its standard uncertainty; `within_s` bounded it before."""

    late_s: float
    uncertainty_s: float
    within_s: float


def fit_time_shift(
    photographs: Sequence[Array], masks_at: Callable[[float, tuple[int, int]], Sequence[Masks]], within_s: float
) -> TimeShift:
    """The shift of least residual, uniform within `within_s`; masks_at : the masks of a shift for a frame. Raises what
    those of 0 raise."""
    z = checks.check_photographs([_middle(photograph) for photograph in photographs])
    shape, trust = (z.shape[2], z.shape[3]), checks.trust_of(z)
    freedom = shape[0] * shape[1] / WINDOW**2

    def residual(late_s: float) -> float:
        try:
            masks = masks_at(late_s, shape)
            return noise_of(register(z, trust, masks).z, masks, LEVEL_PX) ** 2
        except (BadInput, Refused):  # the record does not cover the exposure with this shift
            if late_s == 0.0:
                raise
            return np.inf

    count = int(np.clip(np.ceil(within_s / STEP_S), 2, MOST_STEPS))
    tried = within_s * np.arange(-count, count + 1) / count
    values = [residual(float(late_s)) for late_s in tried]
    best = int(np.argmin(values))
    step_s = within_s / count
    low, high = max(tried[best] - step_s, -within_s), min(tried[best] + step_s, within_s)
    fitted = minimize_scalar(residual, bounds=(low, high), method="bounded", options={"xatol": LEAST_S})
    late_s, least = min([(float(fitted.x), float(fitted.fun)), (float(tried[best]), values[best])], key=lambda p: p[1])
    # the residual is a mean of chi-squares: least (1 + shift^2 / u^2 / freedom)
    beside = [one for one in (residual(late_s - step_s / 2), residual(late_s + step_s / 2)) if np.isfinite(one)]
    rise = max(float(np.mean(beside)) / least - 1 if beside else 0.0, 1e-12)
    own_s = step_s / 2 / np.sqrt(rise * freedom)
    prior_s = within_s / np.sqrt(3)
    return TimeShift(late_s, float(np.hypot(LEAST_S, 1 / np.hypot(1 / own_s, 1 / prior_s))), within_s)


def _middle(photograph: Array) -> Array:
    """The central part, at most `SIDE_PX` wide and high, about the same centre."""
    cuts = [max((size - SIDE_PX) // 2, 0) for size in photograph.shape[1:]]
    return photograph[:, cuts[0] : photograph.shape[1] - cuts[0], cuts[1] : photograph.shape[2] - cuts[1]]
