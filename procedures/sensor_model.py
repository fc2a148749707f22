"""Model of a calibrated sensor for other procedures: noise, response, saturation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array

TABLE = 513
"""Number of nodes at which the response is inverted; linear interpolation between them errs by 1e-6."""


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
        return np.asarray(
            (self.dark_variance + self.dsnu**2) / self._slope(light) ** 2 + self.gain * light + (self.prnu * light) ** 2
        )

    def _slope(self, straight: Array) -> Array:
        """Slope of the response relative to that without light."""
        x = straight / self.signal_at_saturation
        return np.asarray(1 + sum(((i + 2) * c * x ** (i + 1) for i, c in enumerate(self.bend)), np.zeros_like(x)))

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
