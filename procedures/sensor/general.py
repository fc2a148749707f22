"""The general model: what the output is worth as a measurement of light, whatever the camera does with it.

EMVA 1288 release 4.0 general, sections 2 and 6: without gain and electrons. Noise of the output, divided by the slope
of the characteristic curve, is noise of the light; the light over that is the signal-to-noise ratio.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from procedures.numbers import GENERAL_DYNAMIC_RANGE, GENERAL_SNR_MAX, GENERAL_THRESHOLD
from procedures.sensor.curves import Curves
from procedures.sensor.measured import IntervalNumber, from_draws

Array = npt.NDArray[np.float64]


def input_snr(curves: Curves) -> Array:
    """Light over its own noise as the output tells it, (1 + draws, levels); 0 where the output no longer rises."""
    slope = np.gradient(curves.signal, curves.light[0], axis=1)
    return np.asarray(curves.light[:1] * np.maximum(slope, 0) / np.sqrt(np.maximum(curves.variance, 1 / 12)))


def threshold(curves: Curves) -> Array:
    """Light that is its own noise, (1 + draws,): noise from dark to the first level grows as light does."""
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
    return {
        GENERAL_SNR_MAX: from_draws(snr[:, best], "1", "largest ratio of light to its noise at a level", n),
        GENERAL_THRESHOLD: from_draws(least, unit, "light that is its own noise, from dark to the first level", n),
        GENERAL_DYNAMIC_RANGE: from_draws(
            curves.light[:, saturation] / least, "1", "light at saturation over threshold", n
        ),
    }
