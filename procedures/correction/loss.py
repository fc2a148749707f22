"""What the field's own error costs a corrected picture, told from the field's covariance.

The picture is a filter of the samples, as in `prediction`: R = w H* / N with N = w |H|^2 + k |D|^2. Another PSF,
H + dH, makes another filter, in first order

    dR = w dH* / N - w^2 H* (H dH* + H* dH) / N^2

and what comes out lies by dR H u from what the right filter gives. As far as R is the best filter of the picture for
the field's PSF this adds to the other errors as independent ones do; where the prior takes more than the best filter
would, dH of one sign makes up for some of that and of the other adds to it, which a covariance cannot tell. dH is
linear in the PSF's parameters, whose covariance the field tells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.correction.optics import Optics
from procedures.correction.prediction import EDGES, Measured
from procedures.correction.priors import Prior

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]
Spectrum = npt.NDArray[np.complexfloating]

PLACES = (5, 7)
"""Rows and columns of the map: the middles of so many parts of the frame."""
SIDE = 64
"""Samples of a window of the picture, which has much light in long waves; the map takes time as the square."""
WINDOWS = 6
"""Windows along each side of a part, at most."""


@dataclass(frozen=True, eq=False)
class FieldError:
    """How far a picture lies from that of the lens's own PSFs, of the plane that shows lightness.

    Attributes
    ----------
    x : (m,), y : (n,) float64
        Places, in pixels of the picture.
    noise, interpolation : (n, m) float64
        Mean square error about each place, white = 1: of the measured PSFs, and of what lies between them.
    """

    x: Array
    y: Array
    noise: Array
    interpolation: Array

    @property
    def rms(self) -> float:
        """Root mean square over the frame, of white."""
        return float(np.sqrt(np.mean(self.noise + self.interpolation)))


def field_error(
    optics: Optics, mosaic: Measured, prior: Prior, tau: float, difference: float, picture: Single
) -> FieldError:
    """The map, for a corrected picture (C, H, W), a prior of strength `tau` and the picture's mean difference."""
    rows, columns = mosaic.shape
    y, x = ((np.arange(n) + 0.5) * size / n - 0.5 for size, n in zip((rows, columns), PLACES, strict=True))
    shown = 1 if mosaic.channels > 1 else 0
    every = optics.showing(shown)
    density = len(every) / optics.pitch**2
    # of several photographs the fields are the same, and err alike
    own = every[: len(every) // optics.photographs]
    responses = {name: optics.responses(name, SIDE) for name in own}
    stiff = tau / (EDGES * difference) * prior.power(SIDE).ravel()
    maps = np.zeros((2, len(y), len(x)))
    for i, j in np.ndindex(maps.shape[1:]):
        power = _power(picture[shown], i, j)
        for name in own:
            at = optics.in_plane(name, np.array([[x[j], y[i]]]))[0]
            field = optics.fields[name]
            H, each = _transfer(responses[name], field.parameters(at[None])[0])
            # planes of one colour err each for itself by noise, alike between the nodes
            shares = (1 / len(own) ** 2, 1 / len(own))
            for kind, (error, share) in enumerate(zip((field.noise, field.interpolation), shares, strict=True)):
                maps[kind, i, j] += share * _added(H, each, error(*at), density, stiff, power)
    return FieldError(x, y, *maps)


def _transfer(responses: Spectrum, parameters: Array) -> tuple[Spectrum, Spectrum]:
    """The transfer function (F,) of sum 1, and what each parameter changes of it, (p, F)."""
    H = parameters @ responses
    light = H[0].real
    return H / light, ((responses - responses[:, :1] * (H / light)) / light).astype(np.complex64)


def _added(H: Spectrum, each: Spectrum, covariance: Array, density: float, stiff: Array, power: Array) -> float:
    """Mean square of what a filter's error of that covariance (p, p) makes of a picture of that power (F,)."""
    # a real matrix times complex numbers: their parts, as numpy would make the matrix complex too
    spread = (covariance.astype(np.float32) @ each.view(np.float32)).view(np.complex64)
    variance, pseudo = np.sum(each.conj() * spread, axis=0).real, np.sum(each * spread, axis=0)
    N = np.maximum(density * np.abs(H) ** 2 + stiff, 1e-12)
    of_conjugate = density / N - (density * np.abs(H) / N) ** 2
    of_own = -((density * H.conj() / N) ** 2)
    change = (np.abs(of_conjugate) ** 2 + np.abs(of_own) ** 2) * variance
    change += 2 * np.real(of_own * of_conjugate * pseudo)
    return float(np.sum(change * np.abs(H) ** 2 * power))


def _power(picture: Single, i: int, j: int) -> Array:
    """Mean power of the windows of a part of the picture, (F,), its sum the mean square about their means; each
    frequency of the half plane as often as it counts."""
    down, across = (_starts(k, size, n) for k, size, n in zip((i, j), picture.shape, PLACES, strict=True))
    found = [_window_power(picture[top : top + SIDE, left : left + SIDE]) for top in down for left in across]
    return np.asarray(np.mean(found, axis=0))


def _starts(k: int, size: int, n: int) -> list[int]:
    """Where windows begin along one axis of part k of n."""
    last = max(min((k + 1) * size // n, size) - SIDE, 0)
    first = min(k * size // n, last)
    count = int(np.clip((last - first) // (SIDE // 2) + 1, 1, WINDOWS))
    return [round(float(at)) for at in np.linspace(first, last, count)]


def _window_power(part: Single) -> Array:
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in part.shape))
    window /= np.sqrt(np.mean(window**2))
    counted = np.full((SIDE, SIDE // 2 + 1), 2.0)
    counted[:, [0, -1]] = 1
    F = np.fft.rfft2((part - part.mean(dtype=np.float64)) * window, (SIDE, SIDE))
    return np.asarray(counted * np.abs(F) ** 2).ravel() / SIDE**2 / part.size
