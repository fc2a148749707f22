"""Measured characteristic and photon transfer curves, and draws of them.

Every number of the temporal part is a function of these curves, so one computation gives number and interval: it runs
over the measured curves and over draws with the errors of pictures of finite size.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.sensor.rounding import NEGLIGIBLE, finite_pixels, subtracted, unrounded
from procedures.sensor.stacks import SensorRecording, column
from procedures.sensor.uniformity import core_variance

DRAWS = 1000  # sufficient for standard uncertainties to 2 %


@dataclass(frozen=True, eq=False)
class Curves:
    """Levels by light; the first row is measured, the others are draws.

    light : (1 + draws, levels), photons per pixel, or a quantity proportional to them
    signal : (1 + draws, levels), mean digital number less that in the dark at the same exposure time
    variance : (1 + draws, levels), temporal variance before rounding, plus 1/12
    excess : (1 + draws, levels), temporal variance less that in the dark
    dark_mean, dark_variance : (1 + draws, dark levels) float64
    dark_exposure_s : (dark levels,) float64
    light_spread : relative standard deviation of the light from picture to picture
    samples : samples per level
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
    """The measured curves, and draws of normally distributed means and variances; changes of the light, estimated from
    pairs, are drawn as errors of the light."""
    (mean, variance), (dark_mean, dark_variance) = (
        tuple(
            _drawn(
                [getattr(one, name) for one in levels], [getattr(one, f"{name}_variance") for one in levels], rng, draws
            )
            for name in ("mean", "variance")
        )
        for levels in (recording.lights, recording.darks)
    )
    if np.min(dark_variance[0]) < NEGLIGIBLE:
        pixels = _before_rounding(recording, dark_mean, dark_variance, rng)
        for i in np.flatnonzero(variance[0] < NEGLIGIBLE):
            mean[:, i], variance[:, i] = subtracted(mean[:, i], variance[:, i], pixels)
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
        column(dark.exposure_s for dark in recording.darks),
        spread,
        int(np.median(column(one.samples for one in recording.lights))),
    )


def _before_rounding(recording: SensorRecording, mean: Array, variance: Array, rng: np.random.Generator) -> Array:
    """Replace means and variances (1 + draws, dark levels) by those before rounding, plus 1/12; the standard deviation
    (1 + draws,) of the pixels' means."""
    spatial, uncertainty, pixels = np.zeros(len(mean)), np.inf, np.zeros(len(mean))
    if recording.dark_stack is not None:
        value, uncertainty = core_variance(recording.dark_stack)
        spatial = _drawn([value], [uncertainty**2], rng, len(mean) - 1)[:, 0]
    for i, level in enumerate(recording.darks):
        more = finite_pixels(level.variance, float(spatial[0]), level.samples)
        scatter = np.sqrt(more)[:, None] * np.column_stack([np.zeros(3), rng.standard_normal((3, len(mean) - 1))])
        variances = np.array([level.mean_variance, level.variance_variance, uncertainty**2]) + more
        before = unrounded(np.array([mean[:, i], variance[:, i], spatial]) + scatter, variances, rng)
        mean[:, i], variance[:, i] = before.mean, before.temporal
        pixels = np.sqrt(np.maximum(before.spatial, 0.0))
    return pixels


def light_spread(recording: SensorRecording) -> float:
    """Relative standard deviation of the light from one picture to the next, without noise of the pictures."""
    change = column(light.change for light in recording.lights) ** 2
    noise = column(light.change_variance for light in recording.lights)
    signal = recording.signal
    bright = np.abs(signal) > 0.05 * np.abs(signal).max()
    share = (change - noise)[bright] / (2 * signal[bright] ** 2)
    return float(np.sqrt(max(share.mean(), 0.0)))


def _drawn(values: Sequence[float], variances: Sequence[float], rng: np.random.Generator, draws: int) -> Array:
    """Estimates and draws of them, (1 + draws, n)."""
    rows = np.tile(np.array(values, dtype=np.float64), (draws + 1, 1))
    rows[1:] += np.sqrt(np.array(variances, dtype=np.float64)) * rng.standard_normal(rows[1:].shape)
    return rows
