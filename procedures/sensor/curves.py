"""The characteristic curve and the photon transfer curve, as measured and as they might as well have been.

Every number of the temporal part is a function of these curves, so one computation gives number and interval: it runs
over the measured curves and over draws of them, whose spread is that of pictures of finite size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.sensor.levels import LightLevel
from procedures.sensor.recording import SensorRecording, column

Array = npt.NDArray[np.float64]

DRAWS = 1000
"""Enough that a standard uncertainty is known to 2 %."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Levels by light; the first row is what was measured, the others are draws.

    Attributes
    ----------
    light : (1 + draws, levels) float64
        Photons per pixel, or what is proportional to them.
    signal : (1 + draws, levels) float64
        Mean digital number less that in the dark at the same exposure time.
    variance : (1 + draws, levels) float64
        Temporal variance.
    excess : (1 + draws, levels) float64
        The same less that in the dark.
    dark_mean, dark_variance : (1 + draws, dark levels) float64
    dark_exposure_s : (dark levels,) float64
    light_spread : float
        Relative standard deviation of the light from picture to picture.
    samples : int
        Of a level.
    """

    light: Array
    signal: Array
    variance: Array
    excess: Array
    dark_mean: Array
    dark_variance: Array
    dark_exposure_s: Array
    light_spread: float
    samples: int


def curves_of(recording: SensorRecording, rng: np.random.Generator, draws: int = DRAWS) -> Curves:
    """The measured curves and draws of them.

    Means and variances of so many samples are normal; the light's own changes, as pairs show them, move the means of
    the levels, which is drawn as light that was not what it was said to be.
    """
    mean, variance = _drawn(recording.lights, rng, draws)
    dark_mean, dark_variance = _drawn(recording.darks, rng, draws)
    weights = recording.dark_weights.T
    spread = light_spread(recording)
    light = np.tile(column(one.light for one in recording.lights), (draws + 1, 1))
    light[1:] *= 1 + spread / np.sqrt(2) * rng.standard_normal(light[1:].shape)
    return Curves(
        light,
        mean - dark_mean @ weights,
        variance,
        variance - dark_variance @ weights,
        dark_mean,
        dark_variance,
        column(one.exposure_s for one in recording.darks),
        spread,
        int(np.median(column(one.samples for one in recording.lights))),
    )


def light_spread(recording: SensorRecording) -> float:
    """Relative standard deviation of the light from one picture to the next, noise of the pictures taken out."""
    change = column(one.change for one in recording.lights) ** 2
    noise = column(one.change_variance for one in recording.lights)
    signal = recording.signal
    bright = signal > 0.05 * signal.max()
    share = (change - noise)[bright] / (2 * signal[bright] ** 2)
    return float(np.sqrt(max(share.mean(), 0.0)))


def _drawn(levels: Sequence[LightLevel], rng: np.random.Generator, draws: int) -> tuple[Array, Array]:
    """Means and variances of the levels and draws of them, each (1 + draws, levels)."""
    mean = _scattered([(one.mean, one.mean_variance) for one in levels], rng, draws)
    return mean, _scattered([(one.variance, one.variance_variance) for one in levels], rng, draws)


def _scattered(estimates: Sequence[tuple[float, float]], rng: np.random.Generator, draws: int) -> Array:
    """Estimates, of which value and variance are told, and draws of them, (1 + draws, n)."""
    value, variance = np.array(estimates, dtype=np.float64).reshape(-1, 2).T
    values = np.tile(value, (draws + 1, 1))
    values[1:] += np.sqrt(variance) * rng.standard_normal(values[1:].shape)
    return values
