"""Transfer function of a round pupil with aberrations, and its derivatives: autocorrelation by Fourier transforms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.fft

from procedures.numerics.arrays import Array, Complex

TERMS = (
    "defocus", "astigmatism_oblique", "astigmatism", "coma_y", "coma_x", "trefoil_y", "trefoil_x", "spherical",
)  # fmt: skip
"""Noll's polynomials 4 to 11, of unit root mean square over the pupil."""
LEAST_ACROSS = 48
"""Samples across the pupil: the error of the discs' overlap is then 2e-3 of its peak."""
SUBSAMPLES = 8


@dataclass(frozen=True, eq=False)
class Pupil:
    """A round pupil on a grid, with its autocorrelation at frequencies `step` apart, up to `highest`.

    cutoff : cutoff frequency, cycles per pixel; step, highest : spacing and maximum of the frequencies, cycles per
    pixel.
    """

    cutoff: float
    step: float
    highest: float

    def otf_and_slopes(self, waves: Array, terms: tuple[int, ...]) -> tuple[Complex, list[Complex]]:
        """OTF and its derivatives with respect to the given aberrations, (2 h + 1, 2 h + 1) each."""
        _, zernikes = self._sampled()
        field = self._field(waves)
        amplitude, *changes = self._spectra(np.stack([field, *(2j * np.pi * zernikes[list(terms)] * field)]))
        slopes = [2 * np.real(np.conj(amplitude) * change) for change in changes]
        otf, *derivatives = self._correlated(np.stack([np.abs(amplitude) ** 2, *slopes]))
        return otf, derivatives

    def strehl(self, waves: Array) -> float:
        """Strehl ratio: peak of the PSF over that without aberrations, maximised over piston and tilt."""
        return float(np.abs(self._field(waves).sum()) ** 2 / self._sampled()[0].sum() ** 2)

    @property
    def _finer(self) -> int:
        return max(int(np.ceil(LEAST_ACROSS * self.step / self.cutoff)), 1)

    def _sampled(self) -> tuple[Array, Array]:
        return _disc(self.cutoff / 2 / (self.step / self._finer))

    def _field(self, waves: Array) -> Complex:
        """Complex amplitude in the pupil, (n, n)."""
        disc, zernikes = self._sampled()
        return np.asarray(disc * np.exp(2j * np.pi * np.tensordot(waves, zernikes, axes=1)))

    def _spectra(self, fields: Complex) -> Complex:
        """Fourier transforms of fields (m, n, n), on a grid twice as wide, so that their squares do not wrap round."""
        size = scipy.fft.next_fast_len(2 * fields.shape[-1])
        return np.asarray(scipy.fft.fft(scipy.fft.fft(fields, size, axis=2), size, axis=1))

    def _correlated(self, powers: Array) -> Complex:
        """Autocorrelations of power spectra (m, size, size) at the requested frequencies, normalised to 1 at zero
        without aberrations."""
        disc, _ = self._sampled()
        size, finer, count = powers.shape[-1], self._finer, round(self.highest / self.step)
        reach = min(count, (size // 2 - 1) // finer)
        rows = finer * np.arange(-reach, reach + 1)
        half = scipy.fft.rfft(powers, axis=2)[:, :, : finer * reach + 1 : finer]
        # the field's correlation at a shift is the intensity's spectrum at the opposite frequency
        right = scipy.fft.fft(half, axis=1)[:, rows % size] / (size**2 * disc.sum())
        # at zero shift the covered fractions are squared and underestimate the area; elsewhere they represent it
        right[:, reach, 0] *= disc.sum() / np.sum(disc**2)
        correlated = np.zeros((len(powers), 2 * count + 1, 2 * count + 1), dtype=np.complex128)
        inside = slice(count - reach, count + reach + 1)
        correlated[:, inside, inside] = np.concatenate([right[:, ::-1, :0:-1].conj(), right], axis=2)
        return correlated


@lru_cache(maxsize=16)
def _disc(radius: float) -> tuple[Array, Array]:
    """A disc of given radius in samples, its rim by covered fractions, and the aberrations on it (8, n, n)."""
    half = int(np.ceil(radius)) + 1
    fine = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    x = np.arange(-half, half + 1)
    points = (x[:, None] + fine).ravel() / radius
    r2 = points**2 + (points**2)[:, None]
    n = len(x)
    disc = (r2 <= 1).reshape(n, SUBSAMPLES, n, SUBSAMPLES).mean(axis=(1, 3))
    return disc, _zernikes(x / radius, (x / radius)[:, None])


def _zernikes(x: Array, y: Array) -> Array:
    """Noll's polynomials 4 to 11 at points of the unit disc and slightly beyond."""
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
