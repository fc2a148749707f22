"""Detection of clipping in the samples: they accumulate at their largest or smallest value.

A sensor, a converter or a program may clip light anywhere below the nominal white, and black anywhere above 0. Clipped
samples have one value where noise would spread them over several. A uniform area without noise has one value too, so
there must be noise elsewhere, or an approach to that value more abrupt than any lens allows.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32, distinct, quantile

NOMINAL = 0.998  # level from which samples count as saturated; white is 1, and gain corrections shift it by a few steps
MAX_OUTLIERS = 0.0005  # share of the samples, hot pixels and dust, that may lie beyond the peak
MIN_PEAK_SHARE = 0.005  # least share of the samples in a peak
MIN_PEAK_SAMPLES = 6
"""Least number of samples in a peak: of few samples, as in a small chart's blocks, two are equal by chance."""
MIN_PEAK_RATIO = 2.0  # least ratio of the samples in a peak to those at the adjacent values
MIN_DARK_NOISE, MIN_BRIGHT_NOISE = 0.3, 2.0
"""Noise in quantisation steps above which the other end must be noisy: of the dark end for the bright one, as noise
never decreases with light, and of the bright end for the dark one."""
APPROACH_START, APPROACH_END = 0.005, 0.05
"""Range of distances from an end in which its approach is counted, relative to the contrast."""
LOW_QUANTILE = 0.02  # quantile of the samples used as the other end
MAX_APPROACH_RATIO = 0.55
"""Ratio of the samples on the approach to a peak to those at the other end below which it is clipped."""
MAX_STEP_SAMPLES = 200_000  # number of samples used to determine the step


@dataclass(frozen=True)
class Clipping:
    """Shares of clipped samples: `black` at their smallest value, `white` at their largest."""

    black: float
    white: float


def find_clipping(
    samples: Array32 | Array, quantisation: float = 0.0, *, dark_noise: float = 0.0,
    bright_noise: float = 0.0, of_edge: bool = False,
) -> Clipping:  # fmt: skip
    """Estimate the shares of samples clipped at their smallest and largest value, and at the nominal white.

    samples : of any shape, black 0 and nominal white 1
    quantisation : one digital number in these units; larger steps are detected
    dark_noise, bright_noise : standard deviations of the noise in dark and bright parts, in these units; 0 if not known
    of_edge : whether the samples are of one edge between two plains, whose approaches are then compared too
    """
    values = np.ravel(samples).astype(np.float64)
    values = values[np.isfinite(values)]
    if not len(values):
        return Clipping(0.0, 0.0)
    step = step_of(values, quantisation)
    nominal = float(np.mean(values >= NOMINAL))
    white = _clipped_share(values, step, dark_noise, MIN_DARK_NOISE, of_edge)
    black = _clipped_share(-values, step, bright_noise, MIN_BRIGHT_NOISE, of_edge)
    return Clipping(black, max(white, nominal))


def step_of(values: Array, quantisation: float) -> float:
    """Distance of adjacent values (n,); more than `quantisation` where the bit depth was increased."""
    levels = distinct(values[:: max(1, len(values) // MAX_STEP_SAMPLES)])
    return max(quantisation, quantile(np.diff(levels), 0.1) if len(levels) > 1 else 0.0)


def _clipped_share(values: Array, step: float, noise: float, least_steps: float, of_edge: bool) -> float:
    """Share of values clipped at the upper end; `noise` is that of the other end."""
    stray = int(MAX_OUTLIERS * len(values))
    peak = float(np.partition(values, len(values) - 1 - stray)[len(values) - 1 - stray])
    top = values[values > peak - 4 * step]
    counts = [np.count_nonzero(np.abs(top - peak + i * step) < step / 2) for i in range(4)]
    share = counts[0] / len(values)
    if share < MIN_PEAK_SHARE or counts[0] < MIN_PEAK_SAMPLES or counts[0] < MIN_PEAK_RATIO * max(counts[1:]):
        return 0.0
    clipped = noise > least_steps * step or (of_edge and _abrupt(values, peak, max(2.5 * step, 4 * noise)))
    return share if clipped else 0.0


def _abrupt(values: Array, peak: float, blur: float) -> bool:
    """Whether far fewer values lie on the approach to the upper end than to the lower one, both blurred by `blur`."""
    low = quantile(values, LOW_QUANTILE)
    near = max(APPROACH_START * (peak - low), blur)
    far = near + (APPROACH_END - APPROACH_START) * (peak - low)
    above, below = (
        np.count_nonzero((distance > near) & (distance < far)) for distance in (peak - values, values - low)
    )
    return bool(above < MAX_APPROACH_RATIO * below)


# --- Model of a calibrated sensor for other procedures: noise, response, saturation ---

TABLE = 513  # number of nodes at which the response is inverted; linear interpolation between them errs by 1e-6


@dataclass(frozen=True)
class SensorModel:
    """Calibration of one plane's sensor, in digital numbers of its file.

    The signal y - dark of light x, 1 where the temporal variance is largest, is
    `signal_at_saturation` (x + c1 x^2 + c2 x^3): `bend` is (c1, c2).

    gain : gain K of small signals, digital numbers per electron
    gain_uncertainty : standard uncertainty of the gain
    dark_level, dark_variance : mean and temporal variance without light, rounding included
    saturation : signal above which the samples are clipped
    signal_at_saturation : signal of light 1 by the initial slope of the response
    bend_uncertainty : largest standard uncertainty of the response's nonlinearity, over the signal at saturation
    dsnu, prnu : standard deviation of the pixels in the dark, and of their relative response, which act as noise in a
        single picture; 0 if not known
    """

    gain: float
    gain_uncertainty: float
    dark_level: float
    dark_variance: float
    saturation: float
    signal_at_saturation: float
    bend: tuple[float, ...] = ()
    bend_uncertainty: float = 0.0
    dsnu: float = 0.0
    prnu: float = 0.0

    def linearised_variance(self, straight: Array) -> Array:
        """Temporal and spatial variance of a picture's linearised samples at the mean `straight`. Photon noise and PRNU
        enter before the nonlinearity, dark noise and DSNU after it."""
        light = np.maximum(straight, 0)
        x = light / self.signal_at_saturation
        slope = np.asarray(1 + sum(((i + 2) * c * x ** (i + 1) for i, c in enumerate(self.bend)), np.zeros_like(x)))
        return np.asarray((self.dark_variance + self.dsnu**2) / slope**2 + self.gain * light + (self.prnu * light) ** 2)

    def bent(self, straight: Array) -> Array:
        """Signal of the sensor for a linearised signal: the inverse of `linearised`."""
        x = straight / self.signal_at_saturation
        nonlinear = sum((c * np.maximum(x, 0) ** (i + 2) for i, c in enumerate(self.bend)), np.zeros_like(x))
        return np.asarray((x + nonlinear) * self.signal_at_saturation)

    def linearised(self, signal: npt.NDArray[np.floating]) -> Array:
        """Linearised signal, by the initial slope of the response; same shape."""
        if not any(self.bend):
            return np.asarray(signal, dtype=np.float64)
        straight = np.linspace(0, 1.1, TABLE) * self.signal_at_saturation
        value = np.asarray(signal, dtype=np.float64)
        inside = np.interp(value, np.maximum.accumulate(self.bent(straight)), straight)
        return np.asarray(np.where(value <= 0, value, inside))
