"""Signal-to-noise ratios by the general model, and by the linear one.

EMVA 1288 release 4.0 general, sections 2 and 6: without gain and electrons. Noise of the output, divided by the slope
of the characteristic curve, is noise of the light; the light over that is the signal-to-noise ratio. Release 4.0
linear, sections 2.4 and 4.3.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from procedures.numbers import DSNU, GENERAL_DYNAMIC_RANGE, GENERAL_SNR_MAX, GENERAL_THRESHOLD, PRNU
from procedures.numerics.arrays import Array
from procedures.sensor.curves import Curves
from procedures.sensor.measured import IntervalNumber, from_draws
from procedures.sensor.photon_transfer import Transfer


def input_snr(curves: Curves) -> Array:
    """Light over its noise derived from the output, (1 + draws, levels); 0 where the output no longer rises."""
    slope = np.gradient(curves.signal, curves.light[0], axis=1)
    return np.asarray(curves.light[:1] * np.maximum(slope, 0) / np.sqrt(np.maximum(curves.variance, 1 / 12)))


def threshold(curves: Curves) -> Array:
    """Light equal to its noise, (1 + draws,), with noise linear in the light from dark to the first level."""
    light, signal = curves.light[0, 0], curves.signal[:, 0]
    slope = signal / light
    growth = curves.excess[:, 0] / light
    dark = curves.variance[:, 0] - curves.excess[:, 0]
    return np.asarray((growth + np.sqrt(growth**2 + 4 * slope**2 * dark)) / (2 * slope**2))


def general_numbers(curves: Curves, saturation: int, *, photons_known: bool) -> Mapping[str, IntervalNumber]:
    """Largest SNR, threshold and dynamic range of the general model."""
    snr = input_snr(curves)[:, : saturation + 1]
    best = int(np.argmax(snr[0]))
    least, n = threshold(curves), curves.samples
    unit = "photons" if photons_known else "unit of light"
    dynamic_range = curves.light[:, saturation] / least
    return {
        GENERAL_SNR_MAX: from_draws(snr[:, best], "1", "largest ratio of light to its noise at a level", n),
        GENERAL_THRESHOLD: from_draws(least, unit, "light that is its own noise, from dark to the first level", n),
        GENERAL_DYNAMIC_RANGE: from_draws(dynamic_range, "1", "light at saturation over threshold", n),
    }


def linear_snr(transfer: Transfer, light: Array) -> Array:
    """Temporal SNR of one pixel at light (n,): electrons over dark noise, rounding and photon noise."""
    e, variance = _electrons(transfer, light)
    return np.asarray(e / np.sqrt(variance))


def total_snr(transfer: Transfer, numbers: Mapping[str, IntervalNumber], light: Array) -> Array:
    """SNR of one picture at light (n,), including DSNU and PRNU; NaN where these are not known."""
    if PRNU not in numbers:
        return np.full(len(light), np.nan)
    e, variance = _electrons(transfer, light)
    dsnu_e, prnu = numbers[DSNU].value, numbers[PRNU].value / 100
    return np.asarray(e / np.sqrt(variance + dsnu_e**2 + (prnu * e) ** 2))


def _electrons(transfer: Transfer, light: Array) -> tuple[Array, Array]:
    """Mean electrons at light (n,), and their temporal variance."""
    e, dark_e = light * transfer.responsivity[0] / transfer.gain[0], transfer.dark_deviation[0] / transfer.gain[0]
    return e, e + dark_e**2
