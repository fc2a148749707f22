"""Spectrograms of a mean picture along rows and columns, and periodic patterns in them.

EMVA 1288 release 4.0 linear, section 8.3: every line is transformed, and the power of all lines is averaged; its root
is drawn over frequency. A pattern common to all lines is most significant in their average.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from procedures.numerics.arrays import Array
from procedures.sensor.defects import IntervalNumber, measured
from procedures.sensor.stacks import FrameStack, Numbers

FALSE_ALARM = 1e-3  # probability of a false detection in a line of pure noise
FLOOR_BINS = 101  # neighbouring frequencies whose median power is the noise floor
MEDIAN = np.log(2) ** 2
"""Efficiency of the median relative to the mean for an exponential distribution; half of it at the ends, where the
neighbouring frequencies are mirrored."""
MOST = 8
LEAST_CYCLES = 3  # minimum number of periods within the picture: slower patterns are uneven light


@dataclass(frozen=True, eq=False)
class Spectrogram:
    """Root of the mean power over frequency.

    direction : "horizontal": along rows, or "vertical"
    frequencies : (n,), in cycles per pixel, from 0 to 1/2
    amplitude : (n,), in digital numbers, or per cent of the signal; its mean square is the variance
    floor : amplitude of temporal noise alone
    """

    direction: str
    frequencies: Array
    amplitude: Array
    floor: float


@dataclass(frozen=True)
class Period:
    """A sinusoid common to all lines.

    pattern : "row": the rows differ, along a column; or "column"
    frequency : in cycles per pixel
    amplitude : from the mean to the crest
    """

    pattern: str
    frequency: IntervalNumber
    amplitude: IntervalNumber


def spectrogram(stack: FrameStack, direction: str, scale: float = 1.0) -> Spectrogram:
    """Spectrogram of a mean picture along one direction, times a scale."""
    field = stack.mean_picture - stack.mean
    field = field if direction == "horizontal" else field.T
    length = field.shape[1]
    power = np.mean(np.abs(np.fft.rfft(field, axis=1)) ** 2, axis=0) / length
    floor = float(np.sqrt(stack.residual_variance[0])) * scale
    return Spectrogram(direction, np.asarray(np.fft.rfftfreq(length), dtype=np.float64), np.sqrt(power) * scale, floor)


def find_periods(picture: Array, pattern: str, unit: str, scale: float = 1.0) -> tuple[Period, ...]:
    """Sinusoids of the rows' or columns' averages, the strongest first.

    picture : (rows, columns) float64
    pattern : "row" or "column"
    unit : unit of an amplitude after multiplication by the scale
    """
    profile = picture.mean(axis=1 if pattern == "row" else 0)
    residual = profile - profile.mean()
    waves: list[tuple[float, float]] = []
    while len(waves) < MOST and (peak := _highest_peak(residual)) is not None:
        frequency, cosine, sine = _refined(residual, peak)
        phase = 2 * np.pi * frequency * np.arange(len(residual))
        residual = residual - cosine * np.cos(phase) - sine * np.sin(phase)
        waves.append((frequency, float(np.hypot(cosine, sine))))
    noise = float(np.std(residual))
    periods = [_period(pattern, f, a, noise, len(residual), unit, scale) for f, a in waves]
    return tuple(sorted(periods, key=lambda one: -one.amplitude.value))


def _highest_peak(profile: Array) -> float | None:
    """Frequency of the highest peak over the floor around it; None where it is consistent with noise."""
    power = np.abs(np.fft.rfft(profile)) ** 2
    width = min(FLOOR_BINS, len(power) // 2 * 2 - 1)
    floor = median_filter(power[1:], width, mode="reflect") / np.log(
        2
    )  # median of an exponential distribution over its mean
    ratio = power[1:] / np.maximum(floor, 1e-300)
    ratio[: LEAST_CYCLES - 1] = 0
    best = int(np.argmax(ratio))
    # quantile of an exponential value over the mean of `count` others: (1 + t / n)^-n
    count = MEDIAN * width / 2
    limit = float(count * ((FALSE_ALARM / len(ratio)) ** (-1 / count) - 1))
    if ratio[best] < limit:
        return None
    return (best + 1) / len(profile)


def _refined(profile: Array, start: float) -> tuple[float, float, float]:
    """Frequency, cosine and sine of the best sinusoid near a bin's frequency, by Gauss-Newton iterations."""
    n = np.arange(len(profile), dtype=np.float64) - (len(profile) - 1) / 2
    # the strongest of frequencies a tenth of a bin apart
    tried = start + np.linspace(-0.6, 0.6, 13) / len(profile)
    frequency = float(tried[np.argmax(np.abs(np.exp(-2j * np.pi * np.outer(tried, n)) @ profile))])
    for _ in range(8):
        c, s = np.cos(2 * np.pi * frequency * n), np.sin(2 * np.pi * frequency * n)
        a, b = np.linalg.lstsq(np.column_stack([c, s]), profile, rcond=None)[0]
        slope = 2 * np.pi * n * (b * c - a * s)
        *_, step = np.linalg.lstsq(np.column_stack([c, s, slope]), profile - a * c - b * s, rcond=None)[0]
        frequency += float(np.clip(step, -0.2 / len(profile), 0.2 / len(profile)))
    phase = 2 * np.pi * frequency * n[0]  # relative to the first sample
    a, b = a * np.cos(phase) + b * np.sin(phase), b * np.cos(phase) - a * np.sin(phase)
    return frequency, float(a), float(b)


def _period(pattern: str, f: float, a: float, noise: float, n: int, unit: str, scale: float) -> Period:
    """With the Cramer-Rao bounds as uncertainties. Kay, Estimation Theory, 1993, example 3.14."""
    method = f"sinusoid fitted to the average of each {pattern}"
    of_frequency = np.sqrt(6 / n**3) * noise / (np.pi * a)
    return Period(
        pattern,
        measured(f, float(of_frequency), "cycles/pixel", method, n, least=0.0),
        measured(a * scale, float(np.sqrt(2 / n) * noise * scale), unit, method, n, least=0.0),
    )


# --- The power spectrum of temporal noise (NPS), from the difference of two pictures of even light ---
# Blocks of the difference are transformed under a window; the mean of their squared moduli, divided by the window's
# power, has the variance as its mean over the band. IEC 62220-1, in two dimensions and in pixels.

BLOCK = 32  # side of a block in pixels: number of frequencies along each axis
LEAST_SIDE = 5  # minimum side of a spectrum: two different frequencies on each side of 0
NEIGHBOURS = (35 / 18) ** 2
"""Increase of the variance of sums over frequencies by their correlation, under Hann windows along both axes."""


@dataclass(frozen=True, eq=False)
class NoisePower:
    """The NPS at one signal.

    power : (n, n), [fy, fx] in the order of `numpy.fft.fftfreq`; DN^2 per (cycle/pixel)^2: its mean is the variance
    signal : mean less dark of the pictures, DN
    blocks : averaged blocks: each value has the relative standard uncertainty 1 / sqrt(blocks)
    """

    power: Array
    signal: float
    blocks: int

    @property
    def frequencies(self) -> Array:
        """Along one axis, cycles per pixel, in the order of `power`."""
        return np.asarray(np.fft.fftfreq(len(self.power)), dtype=np.float64)


def measure_noise_power(pictures: Sequence[Numbers], signal: float, block: int = BLOCK) -> NoisePower | None:
    """NPS of pairs of pictures (rows, columns); None where no block fits into them. signal : mean less dark."""
    window = np.hanning(block + 1)[:-1]
    taper = window[:, None] * window[None, :]
    total, count = np.zeros((block, block)), 0
    for a, b in zip(pictures[::2], pictures[1::2], strict=False):
        difference = (np.asarray(b, dtype=np.float64) - a) / np.sqrt(2)
        picture = difference - difference.mean()
        down, across = (length // block for length in picture.shape)
        cut = picture[: down * block, : across * block]
        blocks = cut.reshape(down, block, across, block).swapaxes(1, 2).reshape(-1, block, block)
        total += np.sum(np.abs(np.fft.fft2(blocks * taper)) ** 2, axis=0)
        count += len(blocks)
    return NoisePower(total / count / np.sum(taper**2), signal, count) if count else None
