"""Gain, noise, saturation, dark current and derived numbers. EMVA 1288 release 4.0 linear, sections 2.3, 2.4, 3.1, 6.6
and 7.1.

mu_y and sigma_y^2 are mean and temporal variance of the digital numbers y, K the gain in digital numbers (DN) per
electron, eta the quantum efficiency, sigma_d the dark noise in electrons, sigma_q^2 = 1/12 DN^2 that of rounding:

    mu_y = mu_y.dark + K eta mu_p,    sigma_y^2 = K^2 sigma_d^2 + sigma_q^2 + K (mu_y - mu_y.dark)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from procedures.numbers import (
    DARK_CURRENT,
    DARK_CURRENT_BY_VARIANCE,
    DYNAMIC_RANGE,
    DYNAMIC_RANGE_DB,
    INVERSE_GAIN,
    LINEARITY_ERROR,
    LINEARITY_ERROR_MAX,
    LINEARITY_ERROR_MIN,
    QUANTUM_EFFICIENCY,
    RESPONSIVITY,
    SATURATION_CAPACITY,
    SATURATION_PHOTONS,
    SATURATION_SIGNAL,
    SENSITIVITY_THRESHOLD,
    SENSITIVITY_THRESHOLD_PHOTONS,
    SNR_MAX,
    SNR_MAX_DB,
    SYSTEM_GAIN,
    SYSTEM_GAIN_AT_DARK,
    TEMPORAL_DARK_NOISE,
    TEMPORAL_DARK_NOISE_DN,
)
from procedures.numerics.arrays import Array, Mask
from procedures.sensor.curves import Curves
from procedures.sensor.defects import CONFIDENT, IntervalNumber, bounded, from_draws, measured, positive

REGRESSION = 0.7  # upper limit of the fit of gain and responsivity, relative to the signal at saturation
LEAST_DARK_VARIANCE = 0.24  # DN^2: below this rounding dominates
ROUNDING = 1 / 12  # DN^2
LEAST_EXPOSURES = 3  # exposure times required for dark current


@dataclass(frozen=True, eq=False)
class Transfer:
    """Results of the photon transfer curve, over the draws.

    gain : (1 + draws,), K by the standard: a line through 0
    gain_at_dark : (1 + draws,), K of small signals, corrected for the response's curvature
    gain_bent : standard uncertainty of K by that curvature where it is significant, as the linear model neglects it
    responsivity : (1 + draws,), digital numbers per unit of light
    dark_deviation : (1 + draws,), temporal noise in the dark, DN
    saturation : index of the level at saturation
    fitted : (levels,) bool; levels used in the fits
    """

    gain: Array
    gain_at_dark: Array
    gain_bent: float
    responsivity: Array
    dark_deviation: Array
    saturation: int
    fitted: Mask


def saturation_index(variance: Array) -> int:
    """The level of the largest temporal variance (levels,), above which the numbers are clipped."""
    return int(np.argmax(variance))


def saturation_range(curves: Curves, top: int) -> tuple[int, int]:
    """First and last level between which the maximum of the temporal variance lies, within noise and spacing."""
    spread = np.std(curves.variance[1:], axis=0)
    might = curves.variance[0] > curves.variance[0, top] - 2 * np.hypot(spread, spread[top])
    near = np.flatnonzero(might)
    return max(int(near[0]) - 1, 0), min(int(near[-1]) + 1, len(might) - 1)


def fit_transfer(curves: Curves, response: "Response") -> Transfer:
    """Gain, responsivity and dark noise of the measured curves and all draws."""
    top = saturation_index(curves.variance[0])
    fitted = curves.signal[0] <= REGRESSION * curves.signal[0, top]
    gain = _through_zero(curves.signal[:, fitted], curves.excess[:, fitted])
    # photon noise is scaled by the slope of the response: it is linear in slope^2 x light
    scaled = response.small_signal(curves.light) * response.relative_slope(curves.light) ** 2
    gain_at_dark = _through_zero(scaled[:, fitted], curves.excess[:, fitted])
    difference = gain - gain_at_dark
    clear = abs(difference[0]) > 2 * np.std(difference[1:])
    return Transfer(
        gain,
        gain_at_dark,
        abs(float(difference[0])) if clear else 0.0,
        _through_zero(curves.light[:, fitted], curves.signal[:, fitted]),
        np.sqrt(np.maximum(dark_variance(curves), ROUNDING)),
        top,
        fitted,
    )


def dark_variance(curves: Curves) -> Array:
    """Temporal variance in the dark, (1 + draws,), extrapolated to exposure 0 from three exposures or more."""
    if len(curves.dark_exposure_s) < 3:
        return curves.dark_variance[:, 0]
    return line(curves.dark_exposure_s, curves.dark_variance)[0]


def line(x: Array, y: Array) -> tuple[Array, Array]:
    """Offsets and slopes (...,) of the least-squares lines through y (..., n) over x (n,)."""
    away = x - x.mean()
    slope = (y @ away) / (away @ away)
    return y.mean(axis=-1) - slope * x.mean(), slope


def _through_zero(x: Array, y: Array) -> Array:
    return np.asarray(np.sum(x * y, axis=-1) / np.sum(x * x, axis=-1))


def transfer_numbers(curves: Curves, transfer: Transfer, *, photons_known: bool) -> Mapping[str, IntervalNumber]:
    """The numbers of sensitivity and noise, by name."""
    n = curves.samples * int(transfer.fitted.sum())
    bent = transfer.gain_bent / transfer.gain[0]
    gain, dark = transfer.gain, transfer.dark_deviation

    def number(values: Array, unit: str, method: str, *, share: float = 0.0) -> IntervalNumber:
        return from_draws(values, unit, method, n, extra=abs(float(values[0])) * share)

    noise_e = _dark_electrons(transfer)
    threshold_e = np.sqrt(dark**2 / gain**2 + 0.25) + 0.5
    numbers: dict[str, IntervalNumber] = {
        SYSTEM_GAIN: number(gain, "DN/e-", "line through 0 of the photon transfer curve, to 70 % of saturation",
                            share=bent),
        SYSTEM_GAIN_AT_DARK: number(transfer.gain_at_dark, "DN/e-", "the same, corrected for the response's curvature"),
        INVERSE_GAIN: number(1 / gain, "e-/DN", "1 / K", share=bent),
        TEMPORAL_DARK_NOISE: bounded(
            from_draws(noise_e, "e-", "variance in the dark less that of rounding, over K", n,
                       extra=abs(float(noise_e[0])) * bent, signed=True)
        ),
        TEMPORAL_DARK_NOISE_DN: number(dark, "DN", "variance in the dark, rounding included"),
        SENSITIVITY_THRESHOLD: number(threshold_e, "e-", "electrons at which the signal is its own noise", share=bent),
        RESPONSIVITY: number(transfer.responsivity, "DN/photon" if photons_known else "DN per unit of light",
                             "line through 0 of the characteristic curve, to 70 % of saturation"),
    }  # fmt: skip
    if photons_known:
        efficiency = transfer.responsivity / gain
        numbers[QUANTUM_EFFICIENCY] = number(efficiency, "1", "responsivity over gain", share=bent)
        numbers[SENSITIVITY_THRESHOLD_PHOTONS] = number(
            threshold_e / efficiency, "photons", "photons at which the signal is its own noise", share=bent
        )
    return {**numbers, **_saturation_numbers(curves, transfer, threshold_e, bent, n, photons_known=photons_known)}


def _saturation_numbers(
    curves: Curves, transfer: Transfer, threshold_e: Array, bent: float, n: int, *, photons_known: bool
) -> Mapping[str, IntervalNumber]:
    """Numbers by the light at saturation, which lies between the levels next to that of the maximum."""
    at, light, signal = transfer.saturation, curves.light[0], curves.signal[0]
    first, last = saturation_range(curves, at)
    low, high = light[first] / light[at], light[last] / light[at]
    capacity = transfer.responsivity * curves.light[:, at] / transfer.gain
    unit, where = "e-", "light of the largest temporal variance; the adjacent levels are the interval"
    numbers: dict[str, IntervalNumber] = {
        SATURATION_CAPACITY: _between(capacity, low, high, 1.0, bent, unit, where, n),
        SNR_MAX: _between(np.sqrt(capacity), low, high, 0.5, bent, "1", "root of the saturation capacity", n),
        DYNAMIC_RANGE: _between(capacity / threshold_e, low, high, 1.0, 0.0, "1",
                                  "saturation capacity over sensitivity threshold", n),
        SATURATION_SIGNAL: _between(curves.signal[:, at], signal[first] / signal[at],
                                      signal[last:].max() / signal[at], 1.0, 0.0, "DN",
                                      "mean less dark at the largest temporal variance", n),
    }  # fmt: skip
    if photons_known:
        numbers[SATURATION_PHOTONS] = _between(curves.light[:, at], low, high, 1.0, 0.0, "photons", where, n)
    for name, in_db in ((DYNAMIC_RANGE, DYNAMIC_RANGE_DB), (SNR_MAX, SNR_MAX_DB)):
        numbers[in_db] = _decibels(numbers[name])
    return numbers


def _between(
    values: Array, low: float, high: float, power: float, bent: float, unit: str, method: str, n: int
) -> IntervalNumber:
    """A number proportional to a power of the light at saturation, which lies between two factors of the value."""
    value = float(values[0])
    own = float(np.hypot(np.std(values[1:]), value * bent * power))
    number = measured(value, own, unit, method, n)
    ends = (number.low - value * (1 - low**power), number.high + value * (high**power - 1))
    spread = float(np.hypot(own, value * (high**power - low**power) / np.sqrt(12)))
    return positive(IntervalNumber(value, unit, spread, method, n, *ends))


def _decibels(number: IntervalNumber) -> IntervalNumber:
    value, low, high = (20 * float(np.log10(max(part, 1e-300))) for part in (number.value, number.low, number.high))
    spread = 20 / np.log(10) * number.uncertainty / number.value
    return IntervalNumber(value, "dB", float(spread), number.method, number.n, low, high)


@dataclass(frozen=True, eq=False)
class GainAndNoise:
    """System gain K and temporal dark noise of a plane, `values` (2,), with their covariance (2, 2)."""

    NAMES: ClassVar[tuple[str, str]] = (SYSTEM_GAIN, TEMPORAL_DARK_NOISE)
    UNITS: ClassVar[tuple[str, str]] = ("DN/e-", "e-")
    values: Array
    covariance: Array


def gain_and_noise(transfer: Transfer) -> GainAndNoise:
    """Both with their covariance, as the second is divided by the first, from the draws; curvature affects both."""
    draws = np.stack([transfer.gain, _dark_electrons(transfer)])
    bent = transfer.gain_bent / transfer.gain[0] * np.array([draws[0, 0], -draws[1, 0]])  # dark noise decreases with K
    return GainAndNoise(draws[:, 0], np.cov(draws[:, 1:], ddof=0) + np.outer(bent, bent))


def _dark_electrons(transfer: Transfer) -> Array:
    """Temporal noise in the dark without that of rounding, (1 + draws,)."""
    return np.asarray(np.sqrt(np.maximum(transfer.dark_deviation**2 - ROUNDING, 0)) / transfer.gain)


def dark_current_numbers(curves: Curves, transfer: Transfer) -> Mapping[str, IntervalNumber]:
    """Dark current by mean and by variance, in electrons per second; empty for fewer than three exposures."""
    times = curves.dark_exposure_s
    if len(np.unique(times)) < LEAST_EXPOSURES:
        return {}
    n, bent = curves.samples * len(times), transfer.gain_bent / transfer.gain[0]
    by_mean = line(times, curves.dark_mean)[1] / transfer.gain
    by_variance = line(times, curves.dark_variance)[1] / transfer.gain**2
    return {
        DARK_CURRENT: from_draws(by_mean, "e-/s", "slope of the dark mean over exposure, over K", n,
                                 extra=abs(float(by_mean[0])) * bent, signed=True),
        DARK_CURRENT_BY_VARIANCE: from_draws(by_variance, "e-/s",
                                             "slope of the dark variance over exposure, over K squared", n,
                                             extra=2 * abs(float(by_variance[0])) * bent, signed=True),
    }  # fmt: skip


# --- Linearity of the response: the standard's error, and a smooth response that other procedures can invert ---
# EMVA 1288 release 4.0 linear, section 6.7: a line is fitted to the characteristic curve from 5 % to 95 % of saturation
# by least relative deviations; the linearity error is the mean of their absolute values.

RANGE = (0.05, 0.95)  # range of the fit, relative to the signal at saturation
LEAST_LEVELS = 5  # minimum number of levels in that range, for a line and its residual
DEGREE = 2  # degree of the polynomial signal / light


@dataclass(frozen=True, eq=False)
class Response:
    """The signal as a polynomial of the light without a constant, for the measured curve and all draws.

    coefficients : (1 + draws, degree + 1), signal / light = c0 + c1 l + c2 l^2 with l the light over `scale`; scale :
    light at saturation.
    """

    coefficients: Array
    scale: float

    @property
    def bend(self) -> Array:
        """Coefficients of higher powers relative to the linear one, (1 + draws, degree)."""
        return np.asarray(self.coefficients[:, 1:] / self.coefficients[:, :1])

    @property
    def bend_uncertainty(self) -> float:
        """Largest standard uncertainty of the deviation from a line, relative to the signal at saturation."""
        x = np.linspace(0, 1, 21)
        powers = x[:, None] ** (np.arange(self.bend.shape[1]) + 2)
        deviation = self.bend[1:] @ powers.T
        deviation -= deviation[:, -1:] * x  # a line is no deviation
        return float(np.max(np.std(deviation, axis=0)))

    def small_signal(self, light: Array) -> Array:
        """Signal at light (1 + draws, n) by linear extrapolation from 0."""
        return np.asarray(self.coefficients[:, :1] * light)

    def relative_slope(self, light: Array) -> Array:
        """Slope of the response at light (1 + draws, n) over that at 0."""
        l = light / self.scale  # noqa: E741
        powers = np.arange(self.coefficients.shape[1])
        terms = self.coefficients[:, None, :] * (powers + 1) * l[..., None] ** powers
        return np.asarray(terms.sum(axis=-1) / self.coefficients[:, :1])


@dataclass(frozen=True, eq=False)
class Linearity:
    """The line through the characteristic curve, and the deviations from it.

    slope, offset : (1 + draws,) float64
    deviation : (1 + draws, levels), relative deviation of the signal from the line
    used : (levels,) bool; levels from 5 % to 95 % of saturation
    """

    slope: Array
    offset: Array
    deviation: Array
    used: Mask


def fit_response(curves: Curves, saturation: int) -> Response:
    """The smooth response up to 95 % of saturation."""
    used = _used(curves, saturation, (0.0, RANGE[1]))
    scale = float(curves.light[0, saturation])
    l, ratio = curves.light[:, used] / scale, curves.signal[:, used] / curves.light[:, used]  # noqa: E741
    # dim levels have noisy ratios
    weight = np.sqrt(np.clip(l[0], 0, 1))
    degree = min(DEGREE, int(used.sum()) - 2)
    design = l[..., None] ** np.arange(max(degree, 0) + 1) * weight[:, None]
    return Response(_solved(design, ratio * weight), scale)


def fit_linearity(curves: Curves, saturation: int) -> Linearity:
    """The line with the least relative deviations, and the deviations at all levels."""
    used = _used(curves, saturation, RANGE)
    light, signal = curves.light[:, used], curves.signal[:, used]
    design = np.stack([light, np.ones_like(light)], axis=-1) / signal[..., None]
    slope, offset = _solved(design, np.ones_like(signal)).T
    fitted = slope[:, None] * curves.light + offset[:, None]
    return Linearity(slope, offset, (curves.signal - fitted) / fitted, used)


def _used(curves: Curves, saturation: int, share: tuple[float, float]) -> Mask:
    signal, full = curves.signal[0], curves.signal[0, saturation]
    inside: Mask = (signal >= share[0] * full) & (signal <= share[1] * full) & (signal > 0)
    return inside


def _solved(design: Array, values: Array) -> Array:
    """Least squares of many systems: design (b, n, p), values (b, n) -> (b, p)."""
    gram = np.einsum("bnp,bnq->bpq", design, design)
    right = np.einsum("bnp,bn->bp", design, values)
    return np.asarray(np.linalg.solve(gram, right[..., None])[..., 0])


def linearity_numbers(linearity: Linearity, alternatives: Sequence[Linearity], n: int) -> Mapping[str, IntervalNumber]:
    """Linearity error and largest deviations to either side in per cent; alternatives : other possible saturation
    levels."""
    deviation = 100 * linearity.deviation[:, linearity.used]
    spread = np.std(deviation[1:], axis=0)
    lift = float(np.mean(spread)) * np.sqrt(2 / np.pi)  # error expected by noise alone
    error = np.mean(np.abs(deviation), axis=1)
    lowest, highest = deviation.min(axis=1), deviation.max(axis=1)
    others = [100 * float(np.mean(np.abs(alternative.deviation[0, alternative.used]))) for alternative in alternatives]
    away = max((abs(other - error[0]) for other in others), default=0.0)
    spread_of_error = float(np.hypot(np.std(error[1:]), away / np.sqrt(3)))
    method = "relative deviation from the line with the least relative deviations, 5 % to 95 % of saturation"
    extreme = CONFIDENT * float(np.max(spread))
    return {
        LINEARITY_ERROR: measured(
            float(error[0]), spread_of_error, "%", f"mean absolute {method}", n, least=0.0, lower=lift
        ),
        LINEARITY_ERROR_MIN: measured(float(lowest[0]), extreme / CONFIDENT, "%", f"lowest {method}", n),
        LINEARITY_ERROR_MAX: measured(float(highest[0]), extreme / CONFIDENT, "%", f"highest {method}", n),
    }
