"""Linearity of the response: the standard's error, and a smooth response that other procedures can invert.

EMVA 1288 release 4.0 linear, section 6.7: a line is fitted to the characteristic curve from 5 % to 95 % of saturation
by least relative deviations; the linearity error is the mean of their absolute values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numbers import LINEARITY_ERROR, LINEARITY_ERROR_MAX, LINEARITY_ERROR_MIN
from procedures.numerics.arrays import Array
from procedures.sensor.curves import Curves
from procedures.sensor.measured import CONFIDENT, IntervalNumber, measured

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
    used: npt.NDArray[np.bool_]


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


def _used(curves: Curves, saturation: int, share: tuple[float, float]) -> npt.NDArray[np.bool_]:
    signal, full = curves.signal[0], curves.signal[0, saturation]
    inside: npt.NDArray[np.bool_] = (signal >= share[0] * full) & (signal <= share[1] * full) & (signal > 0)
    return inside


def _solved(design: Array, values: Array) -> Array:
    """Least squares of many systems: design (b, n, p), values (b, n) -> (b, p)."""
    gram = np.einsum("bnp,bnq->bpq", design, design)
    right = np.einsum("bnp,bn->bp", design, values)
    return np.asarray(np.linalg.solve(gram, right[..., None])[..., 0])


def linearity_numbers(linearity: Linearity, alternatives: Sequence[Linearity], n: int) -> Mapping[str, IntervalNumber]:
    """Linearity error, and the largest deviations to either side, in per cent.

    alternatives : with saturation at other possible levels.
    """
    deviation = 100 * linearity.deviation[:, linearity.used]
    spread = np.std(deviation[1:], axis=0)
    lift = float(np.mean(spread)) * np.sqrt(2 / np.pi)  # error expected by noise alone
    error = np.mean(np.abs(deviation), axis=1)
    lowest, highest = deviation.min(axis=1), deviation.max(axis=1)
    others = [100 * float(np.mean(np.abs(one.deviation[0, one.used]))) for one in alternatives]
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
