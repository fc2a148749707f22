"""Signal-to-noise ratios by the linear model and its numbers. EMVA 1288 release 4.0 linear, sections 2.4 and 4.3."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numbers import DSNU, PRNU
from procedures.sensor.estimate import SensorResult

Array = npt.NDArray[np.float64]


def electrons(result: SensorResult, light: Array) -> Array:
    """Mean electrons at light (n,)."""
    return np.asarray(light * result.transfer.responsivity[0] / result.transfer.gain[0])


def linear_snr(result: SensorResult, light: Array) -> Array:
    """Of one pixel over time: electrons over the root of dark noise, rounding and photon noise."""
    e, dark_e = electrons(result, light), result.transfer.dark_deviation[0] / result.transfer.gain[0]
    return np.asarray(e / np.sqrt(e + dark_e**2))


def total_snr(result: SensorResult, light: Array) -> Array:
    """Of one picture, whose pixels differ too: with DSNU and PRNU; NaN where these are not known."""
    if PRNU not in result.numbers:
        return np.full(len(light), np.nan)
    e, dark_e = electrons(result, light), result.transfer.dark_deviation[0] / result.transfer.gain[0]
    dsnu_e, prnu = result.numbers[DSNU].value, result.numbers[PRNU].value / 100
    return np.asarray(e / np.sqrt(e + dark_e**2 + dsnu_e**2 + (prnu * e) ** 2))
