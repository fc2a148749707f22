"""What is known of a sensor from its own calibration, as other procedures use it: noise, response, saturation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

TABLE = 513
"""Places at which the response is inverted; between them a parabola is a line to a millionth."""


@dataclass(frozen=True)
class SensorModel:
    """One plane's sensor, in digital numbers as its file holds them.

    The signal y - dark of light x, 1 where the temporal variance is largest, is
    `signal_at_saturation` (x + c1 x^2 + c2 x^3): `bend` is (c1, c2).

    Attributes
    ----------
    gain : float
        K of small signals, digital numbers per electron.
    gain_uncertainty : float
        Its standard uncertainty.
    dark_level, dark_variance : float
        Mean and temporal variance without light, rounding included.
    saturation : float
        Signal from which on numbers are cut off.
    signal_at_saturation : float
        Signal that light 1 would give if the response went on as it begins.
    bend : tuple of float
    bend_uncertainty : float
        Largest standard uncertainty of the response's departure from a line, over the signal at saturation.
    dsnu, prnu : float
        Deviation of the pixels in the dark, and of their response as a share of the signal: in one picture they are
        noise. 0 where they are not known.
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

    def straightened_variance(self, straight: Array) -> Array:
        """Variance of one picture's straightened samples where their mean is `straight`: over time, and from pixel to
        pixel. Photon noise and response are before the bend; what is there in the dark comes after it."""
        light = np.maximum(straight, 0)
        return np.asarray(
            (self.dark_variance + self.dsnu**2) / self._slope(light) ** 2 + self.gain * light + (self.prnu * light) ** 2
        )

    def _slope(self, straight: Array) -> Array:
        """Of the response, over that without light."""
        x = straight / self.signal_at_saturation
        return np.asarray(1 + sum(((i + 2) * c * x ** (i + 1) for i, c in enumerate(self.bend)), np.zeros_like(x)))

    def bent(self, straight: Array) -> Array:
        """The signal that the sensor gives where `straightened` says so: its inverse."""
        x = straight / self.signal_at_saturation
        more = sum((c * np.maximum(x, 0) ** (i + 2) for i, c in enumerate(self.bend)), np.zeros_like(x))
        return np.asarray((x + more) * self.signal_at_saturation)

    def straightened(self, signal: npt.NDArray[np.floating]) -> Array:
        """The signal that a response which goes on as it begins would have given; same shape."""
        if not any(self.bend):
            return np.asarray(signal, dtype=np.float64)
        straight = np.linspace(0, 1.1, TABLE) * self.signal_at_saturation
        value = np.asarray(signal, dtype=np.float64)
        inside = np.interp(value, np.maximum.accumulate(self.bent(straight)), straight)
        return np.asarray(np.where(value <= 0, value, inside))
