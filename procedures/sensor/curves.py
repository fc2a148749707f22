"""The characteristic curve and the photon transfer curve, as measured and as they might as well have been.

Every number of the temporal part is a function of these curves, so one computation gives number and interval: it runs
over the measured curves and over draws of them, whose spread is that of pictures of finite size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.sensor.recording import Recording, column

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


def curves_of(recording: Recording, rng: np.random.Generator, draws: int = DRAWS) -> Curves:
    """The measured curves and draws of them.

    Means and variances of so many samples are normal; the light's own changes, as pairs show them, move the means of
    the levels, which is drawn as light that was not what it was said to be.
    """
    mean, variance = (_drawn(recording, "lights", name, rng, draws) for name in ("mean", "variance"))
    dark_mean, dark_variance = (_drawn(recording, "darks", name, rng, draws) for name in ("mean", "variance"))
    weights = recording.dark_weights.T
    spread = light_spread(recording)
    light = np.tile(column(recording.lights, "light"), (draws + 1, 1))
    light[1:] *= 1 + spread / np.sqrt(2) * rng.standard_normal(light[1:].shape)
    return Curves(
        light,
        mean - dark_mean @ weights,
        variance,
        variance - dark_variance @ weights,
        dark_mean,
        dark_variance,
        column(recording.darks, "exposure_s"),
        spread,
        int(np.median(column(recording.lights, "samples"))),
    )


def light_spread(recording: Recording) -> float:
    """Relative standard deviation of the light from one picture to the next, noise of the pictures taken out."""
    change, noise = column(recording.lights, "change") ** 2, column(recording.lights, "change_variance")
    signal = column(recording.lights, "mean") - recording.dark_weights @ column(recording.darks, "mean")
    bright = signal > 0.05 * signal.max()
    share = (change - noise)[bright] / (2 * signal[bright] ** 2)
    return float(np.sqrt(max(share.mean(), 0.0)))


def _drawn(recording: Recording, part: str, name: str, rng: np.random.Generator, draws: int) -> Array:
    """A statistic of all levels of a part and draws of it, (1 + draws, levels)."""
    levels = getattr(recording, part)
    values = np.tile(column(levels, name), (draws + 1, 1))
    values[1:] += np.sqrt(column(levels, f"{name}_variance")) * rng.standard_normal(values[1:].shape)
    return values
