"""Error of a corrected picture due to the field's error, from the field's covariance.

The picture is a linear filter of the samples, as in `prediction`: R = w H* / N with N = w |H|^2 + k |D|^2. A PSF error
dH changes the filter, to first order, by

    dR = w dH* / N - w^2 H* (H dH* + H* dH) / N^2

and the result by dR H u. If R is the optimal filter of the picture for the field's PSF, this error is independent of
the others. Under a stronger prior, dH of one sign compensates part of the prior's effect and dH of the other sign
increases it, which a covariance cannot describe. dH is linear in the PSF's parameters, whose covariance the field
provides.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.correction.mosaic import Mosaic
from procedures.correction.optics import PlaneFields
from procedures.correction.prediction import EDGES, whole_plane
from procedures.correction.priors import Prior

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]
Spectrum = npt.NDArray[np.complexfloating]

PLACES = (5, 7)
"""Rows and columns of the map, at the centres of equal parts of the frame."""
SIDE = 64
"""Side of a window of the picture, whose power is mostly at low frequencies; time grows as its square."""
WINDOWS = 6
"""Maximum number of windows along each side of a part."""


@dataclass(frozen=True, eq=False)
class FieldError:
    """Error of a picture due to errors of the field, for the plane of lightness, at x (m,), y (n,), pixels of it.

    noise, interpolation : (n, m), mean square error about each position, white = 1: due to the measured PSFs, and to
    the interpolation.
    """

    x: Array
    y: Array
    noise: Array
    interpolation: Array

    @property
    def rms(self) -> float:
        """Root mean square over the frame, white = 1."""
        return float(np.sqrt(np.mean(self.noise + self.interpolation)))


def field_error(
    optics: PlaneFields, mosaic: Mosaic, prior: Prior, tau: float, difference: float, picture: Single
) -> FieldError:
    """Map of the error of a corrected picture (C, H, W), for a prior of strength `tau` and a mean difference."""
    rows, columns = mosaic.shape
    y, x = ((np.arange(n) + 0.5) * size / n - 0.5 for size, n in zip((rows, columns), PLACES, strict=True))
    lightness = 1 if mosaic.channels > 1 else 0
    every = [key for key, colour in zip(optics.fields, optics.channel, strict=True) if colour == lightness]
    density = len(every) / mosaic.pitch**2
    # all photographs share the fields and their errors
    planes = every[: len(every) // optics.photographs]
    responses = {name: optics.responses(name, SIDE) for name in planes}
    stiff = tau / (EDGES * difference) * prior.power(SIDE).ravel()
    maps = np.zeros((2, len(y), len(x)))
    for i, j in np.ndindex(maps.shape[1:]):
        power = _power(picture[lightness], i, j)
        for name in planes:
            at = optics.in_plane(name, np.array([[x[j], y[i]]]))[0]
            field = optics.fields[name]
            weight = _weight(responses[name], field.parameters(at[None])[0], density, stiff, power)
            # planes of one colour have independent noise, and a common interpolation error
            shares = (1 / len(planes) ** 2, 1 / len(planes))
            for kind, (error, share) in enumerate(zip((field.noise, field.interpolation), shares, strict=True)):
                maps[kind, i, j] += share * float(np.sum(weight * error(*at)))
    return FieldError(x, y, *maps)


def _weight(responses: Spectrum, parameters: Array, density: float, stiff: Array, power: Array) -> Array:
    """Weights (p, p): the sum of their products with a covariance of the PSF's parameters is the mean square error of a
    filter applied to a picture of power (F,).

    responses : (p, F) derivatives of the transfer function, not normalised
    """
    H = (parameters.astype(np.float32) @ responses.view(np.float32)).view(np.complex64)
    light = H[0].real
    H /= light
    each = (responses - np.outer(responses[:, 0], H)) / light
    N = np.maximum(density * np.abs(H) ** 2 + stiff, 1e-12)
    by_conjugate = density / N - (density * np.abs(H) / N) ** 2
    by_itself = -((density * H.conj() / N) ** 2)
    much = np.abs(H) ** 2 * power
    square = (much * (by_conjugate**2 + np.abs(by_itself) ** 2)).astype(np.float32)
    product = (2 * much * by_conjugate * by_itself).astype(np.complex64)
    # the real part of conj(dH) dH and of dH dH are products of real and imaginary parts
    weighted = square * each + np.conj(product * each)
    return np.asarray(weighted.view(np.float32) @ each.view(np.float32).T)


def _power(picture: Single, i: int, j: int) -> Array:
    """Mean power spectrum (F,) of the windows of a part of the picture; its sum is the mean square about the windows'
    means, with both halves of the plane counted."""
    down, across = (_starts(k, size, n) for k, size, n in zip((i, j), picture.shape, PLACES, strict=True))
    powers = [_window_power(picture[top : top + SIDE, left : left + SIDE]) for top in down for left in across]
    return np.asarray(np.mean(powers, axis=0))


def _starts(k: int, size: int, n: int) -> list[int]:
    """First samples of the windows along one axis of part k of n."""
    last = max(min((k + 1) * size // n, size) - SIDE, 0)
    first = min(k * size // n, last)
    count = int(np.clip((last - first) // (SIDE // 2) + 1, 1, WINDOWS))
    return [round(float(at)) for at in np.linspace(first, last, count)]


def _window_power(part: Single) -> Array:
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in part.shape))
    window /= np.sqrt(np.mean(window**2))
    F = np.fft.rfft2((part - part.mean(dtype=np.float64)) * window, (SIDE, SIDE))
    return whole_plane(np.abs(F) ** 2).ravel() / SIDE**2 / part.size
