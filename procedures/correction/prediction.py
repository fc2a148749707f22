"""Predicted gain and cost of a correction, from its linear approximation: MTF50 before and after, and noise gain.

For differences of length g, a penalty tau |D u| acts as (tau / g) |D u|^2 / 2, and the picture is a linear filter of
the samples: R = w H* / (w |H|^2 + tau / g |D|^2). H R is the transfer function after correction, the mean square of R
the noise gain. Edges have large differences, flat parts average ones.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.correction.mosaic import Mosaic
from procedures.correction.optics import PlaneFields
from procedures.correction.priors import Prior

Array = npt.NDArray[np.float64]

PLACES = (7, 9)
"""Rows and columns of the map."""
EDGES = 10.0
"""Differences at edges relative to the mean difference."""
SIDE = 128
"""Side of the frequency grid."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Maps (n, m) over the frame at x (m,), y (n,), pixels of the picture, for the plane of lightness: green, or grey.

    before, after : MTF50 in cycles per pixel of the picture, mean over directions; 0.5 if it is above the grid's range.
    noise_gain : standard deviation of the picture's noise in flat parts, relative to a sample's.
    """

    x: Array
    y: Array
    before: Array
    after: Array
    noise_gain: Array


def predict(optics: PlaneFields, mosaic: Mosaic, prior: Prior, tau: float, difference: float) -> Prediction:
    """Maps of gain and cost for a prior of strength `tau` and the picture's mean difference."""
    rows, columns = mosaic.shape
    y, x = np.linspace(0, rows - 1, PLACES[0]), np.linspace(0, columns - 1, PLACES[1])
    lightness = 1 if mosaic.channels > 1 else 0
    planes = [p for p, colour in enumerate(optics.channel) if colour == lightness]
    density = len(planes) / mosaic.pitch**2
    power = prior.power(SIDE)
    maps = np.empty((3, len(y), len(x)))
    for i, j in np.ndindex(maps.shape[1:]):
        H = np.abs(optics.otf(float(x[j]), float(y[i]), SIDE)[planes]).mean(axis=0).astype(np.float64)
        edges = density * H / (density * H**2 + tau / (EDGES * difference) * power)
        flat = density * H / (density * H**2 + tau / difference * power)
        maps[:, i, j] = _half(H), _half(H * edges), np.sqrt(whole_plane(flat**2).sum() / SIDE**2 / density)
    return Prediction(x, y, *maps)


def whole_plane(power: Array) -> Array:
    """Powers (n, n // 2 + 1) of a half plane, those of all columns but the first and the last twice."""
    return np.hstack([power[:, :1], 2 * power[:, 1:-1], power[:, -1:]])


def _half(transfer: Array) -> float:
    """Frequency in cycles per sample where the mean over directions first falls below one half; 0.5 if nowhere."""
    f = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.arange(SIDE // 2 + 1) / SIDE)
    rings = np.rint(f * SIDE).astype(int)
    inside = rings <= SIDE // 2
    mean = np.bincount(rings[inside], transfer[inside]) / np.bincount(rings[inside])
    low = np.flatnonzero(mean < 0.5)
    if len(low) == 0 or low[0] == 0:
        return 0.5
    i = int(low[0])
    return float(np.interp(0.5, mean[[i, i - 1]], np.array([i, i - 1]) / SIDE))
