"""Dark current, from how mean and variance in the dark grow with the exposure time. EMVA 1288 release 4.0 linear,
sections 3.1 and 7.1."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from procedures.numbers import DARK_CURRENT, DARK_CURRENT_BY_VARIANCE
from procedures.sensor.curves import Curves
from procedures.sensor.measured import IntervalNumber, from_draws
from procedures.sensor.photon_transfer import Transfer, line

LEAST_EXPOSURES = 3


def dark_current_numbers(curves: Curves, found: Transfer) -> Mapping[str, IntervalNumber]:
    """Dark current by mean and by variance, in electrons per second; nothing where fewer than three exposures tell."""
    times = curves.dark_exposure_s
    if len(np.unique(times)) < LEAST_EXPOSURES:
        return {}
    by_mean, by_variance = line(times, curves.dark_mean)[1], line(times, curves.dark_variance)[1]
    n = curves.samples * len(times)
    return {
        DARK_CURRENT: from_draws(by_mean / found.gain, "e-/s", "slope of the dark mean over exposure, over K", n,
                                   beside=_share(by_mean[0] / found.gain[0], found)),
        DARK_CURRENT_BY_VARIANCE: from_draws(by_variance / found.gain**2, "e-/s",
                                               "slope of the dark variance over exposure, over K squared", n,
                                               beside=2 * _share(by_variance[0] / found.gain[0] ** 2, found)),
    }  # fmt: skip


def _share(value: float, found: Transfer) -> float:
    return float(abs(value) * found.bent / found.gain[0])
