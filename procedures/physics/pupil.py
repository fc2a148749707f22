"""Transfer function of a round pupil with aberrations, and its derivatives: autocorrelation by Fourier transforms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy.fft

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

TERMS = (
    "defocus", "astigmatism_oblique", "astigmatism", "coma_y", "coma_x", "trefoil_y", "trefoil_x", "spherical",
)  # fmt: skip
"""Noll's polynomials 4 to 11, of unit root mean square over the pupil."""
LEAST_ACROSS = 48
"""Samples across the pupil: the discs' overlap is then right to 2e-3 of its peak."""
SUBSAMPLES = 8


@dataclass(frozen=True, eq=False)
class Pupil:
    """A round pupil on a grid whose autocorrelation is wanted at frequencies `step` apart, up to `highest`.

    Attributes
    ----------
    cutoff : float
        Frequency at which nothing passes any more, cycles per pixel.
    step, highest : float
        Of the frequencies, cycles per pixel.
    """

    cutoff: float
    step: float
    highest: float

    def otf(self, waves: Array) -> Complex:
        """At all pairs of frequencies (2 h + 1, 2 h + 1) [fy, fx], for aberrations (8,) in waves."""
        amplitude, size = self._amplitude(waves)
        return self._correlated(np.abs(amplitude) ** 2, size)

    def otf_and_slopes(self, waves: Array, terms: tuple[int, ...]) -> tuple[Complex, list[Complex]]:
        """The same, and its derivatives with some of the aberrations, (2 h + 1, 2 h + 1) each."""
        amplitude, size = self._amplitude(waves)
        disc, zernikes = self._sampled()
        phase = disc * np.exp(2j * np.pi * np.tensordot(waves, zernikes, axes=1))
        slopes = []
        for zernike in zernikes[list(terms)]:
            change = scipy.fft.fft2(2j * np.pi * zernike * phase, (size, size))
            slopes.append(self._correlated(2 * np.real(np.conj(amplitude) * change), size))
        return self._correlated(np.abs(amplitude) ** 2, size), slopes

    def strehl(self, waves: Array) -> float:
        """Peak of the spread function over that without aberrations, piston and tilt free."""
        disc, zernikes = self._sampled()
        field = np.sum(disc * np.exp(2j * np.pi * np.tensordot(waves, zernikes, axes=1)))
        return float(np.abs(field) ** 2 / disc.sum() ** 2)

    @property
    def _finer(self) -> int:
        return max(int(np.ceil(LEAST_ACROSS * self.step / self.cutoff)), 1)

    def _sampled(self) -> tuple[Array, Array]:
        return _disc(self.cutoff / 2 / (self.step / self._finer))

    def _amplitude(self, waves: Array) -> tuple[Complex, int]:
        """Fourier transform of the pupil, on a grid twice as wide: its square does not wrap round."""
        disc, zernikes = self._sampled()
        size = scipy.fft.next_fast_len(2 * len(disc))
        phase = disc * np.exp(2j * np.pi * np.tensordot(waves, zernikes, axes=1))
        return np.asarray(scipy.fft.fft2(phase, (size, size))), size

    def _correlated(self, power: Array, size: int) -> Complex:
        """The autocorrelation of this power spectrum at the wanted frequencies, 1 at zero without aberrations."""
        disc, _ = self._sampled()
        # at no shift the covered shares are squared and fall short of the area; everywhere else they stand for it
        whole = scipy.fft.ifft2(power) / disc.sum()
        whole[0, 0] *= disc.sum() / np.sum(disc**2)
        count = round(self.highest / self.step)
        index = self._finer * np.arange(-count, count + 1)
        inside = np.abs(index) < size // 2
        found = np.zeros((len(index), len(index)), dtype=np.complex128)
        place = np.flatnonzero(inside)
        found[np.ix_(place, place)] = whole[np.ix_(index[inside] % size, index[inside] % size)]
        # the field's correlation at a shift is the light's spectrum at the opposite frequency
        return found[::-1, ::-1]


@lru_cache(maxsize=16)
def _disc(radius: float) -> tuple[Array, Array]:
    """A disc of a radius in samples, its rim by the covered share, and the aberrations on it (8, n, n)."""
    half = int(np.ceil(radius)) + 1
    fine = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    x = np.arange(-half, half + 1)
    points = (x[:, None] + fine).ravel() / radius
    r2 = points**2 + (points**2)[:, None]
    n = len(x)
    disc = (r2 <= 1).reshape(n, SUBSAMPLES, n, SUBSAMPLES).mean(axis=(1, 3))
    return disc, _zernikes(x / radius, (x / radius)[:, None])


def _zernikes(x: Array, y: Array) -> Array:
    """Noll's polynomials 4 to 11 at points of the unit disc, and a little beyond."""
    x, y = np.broadcast_arrays(x, y)
    r2 = x * x + y * y
    return np.stack(
        [
            3**0.5 * (2 * r2 - 1),
            6**0.5 * 2 * x * y,
            6**0.5 * (x * x - y * y),
            8**0.5 * (3 * r2 - 2) * y,
            8**0.5 * (3 * r2 - 2) * x,
            8**0.5 * y * (3 * x * x - y * y),
            8**0.5 * x * (x * x - 3 * y * y),
            5**0.5 * (6 * r2 * r2 - 6 * r2 + 1),
        ]
    )
