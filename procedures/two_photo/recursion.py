"""From the kernel between the two photographs to the PSF of the camera, in Fourier, with the derivative of every step.

With x' = J x the map from far to near pixels, the kernel k and the PSF h are tied by K(f) = H(f) / H(J^-T f): the
near photograph holds the same optics, J times finer. J is kept whole, so that a roll of the camera between the two
photographs, and different zooms along x and y, are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import tail_spectrum, tail_sum
from procedures.numerics.warps import inverse

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

REST = 1e-4
"""The product ends with the first factor that nowhere in the band differs from 1 by more."""
MOST_FACTORS = 40


@dataclass(frozen=True)
class Recovered:
    """A PSF with its dependence on the kernel it came from.

    Attributes
    ----------
    h : (k, k) float64
        On the kernel's grid, inside its support.
    derivative : (k^2, k^2 + 1) float64
        d h / d (k, tau), flattened.
    """

    h: Array
    derivative: Array

    def covariance(self, of_kernel: Array) -> Array:
        """Covariance (k^2, k^2) of the PSF, from that of the kernel and its tail."""
        return np.asarray(self.derivative @ of_kernel @ self.derivative.T)


def psf_by_recursion(total: Array, s: int, J: Array) -> Recovered:
    """The PSF as the product H(f) = K(f) K(J^-T f) K(J^-T J^-T f) ..., every factor exact at its frequencies.

    Parameters
    ----------
    total : (k^2 + 1,) float64
        The inter-image kernel on the s grid and, last, its tail beyond.
    s : int
        Samples per far pixel.
    J : (2, 2) float64
        d(near pixels x, y) / d(far pixels x, y); it must enlarge.

    Raises
    ------
    ValueError
        If J does not enlarge: the product would not end.

    References
    ----------
    Delbracio, Almansa, Muse, IPOL 2013, section 4.4; thesis, Proposition 4. The factors beyond the first are
    normalised at f = 0, where any gain would be raised to their number.
    """
    k = round((len(total) - 1) ** 0.5)
    N = _transform_size(k)
    fx, fy = _half_plane(N, s)
    M = _shrinking(J)
    values: list[Complex] = []
    waves: list[Complex] = []
    gain, ones = gain_of(total), _sums(k)
    for _ in range(MOST_FACTORS):
        wave = _waves(fx, fy, k, s)
        value = wave @ total / (gain if values else 1.0)
        slope = (wave - np.outer(value, ones)) / gain if values else wave
        values.append(value)
        waves.append(np.asarray(slope, dtype=np.complex128))
        if len(values) > 1 and np.abs(values[-1] - 1).max() < REST:
            break
        fx, fy = M[0, 0] * fx + M[0, 1] * fy, M[1, 0] * fx + M[1, 1] * fy
    H = np.prod(values, axis=0)
    dH = sum(np.prod(values[:n] + values[n + 1 :], axis=0)[:, None] * waves[n] for n in range(len(values)))
    h = _samples(H[:, None], N, k).reshape(k, k)
    return Recovered(h, _samples(np.asarray(dH), N, k))


def psf_by_equation(total: Array, s: int, J: Array) -> Recovered:
    """The PSF as the least-squares solution of H(f) - K(f) H(J^-T f) = 0 under equal sums: the recursion's check.

    Here h itself has the k x k support and the tail, in the recursion only the kernel has. Parameters as there.
    """
    k = round((len(total) - 1) ** 0.5)
    gain = gain_of(total)
    fx, fy = _half_plane(_transform_size(k) // 2, s)
    M = _shrinking(J)
    here = _waves(fx, fy, k, s)
    there = _waves(M[0, 0] * fx + M[0, 1] * fy, M[1, 0] * fx + M[1, 1] * fy, k, s)
    K = here @ total / gain
    # the sum is exact against 1e3 equations of order 1e-3
    system = np.vstack([_stacked(np.asarray(here - K[:, None] * there)), 1e3 * _sums(k)[None]])
    solution = np.linalg.pinv(system)
    h = solution[:, -1] * 1e3
    dK = (here - np.outer(K, _sums(k))) / gain
    derivative = solution[:, :-1] @ _stacked(np.asarray((there @ h)[:, None] * dK))
    through_gain = np.outer(h, _sums(k))
    return Recovered(np.asarray(gain * h[:-1]).reshape(k, k), np.asarray(gain * derivative + through_gain)[:-1])


def gain_of(total: Array) -> float:
    """The gain between the photographs: the sum of kernel and tail (k^2 + 1,), the tail taken without an end."""
    return float(_sums(round((len(total) - 1) ** 0.5)) @ total)


def _sums(k: int) -> Array:
    """Spectra of unit samples and tail at f = 0, (k^2 + 1,)."""
    return np.append(np.ones(k * k), tail_sum(k))


def _transform_size(k: int) -> int:
    """Frequencies along one axis: room for the PSF's tails, four supports wide."""
    return int(2 ** np.ceil(np.log2(4 * k)))


def _half_plane(N: int, s: int) -> tuple[Array, Array]:
    """Frequencies (x, y) of the real transform of an N x N s grid, flattened, in cycles per far pixel."""
    fx, fy = np.meshgrid(np.fft.rfftfreq(N) * s, np.fft.fftfreq(N) * s)
    return fx.ravel(), fy.ravel()


def _shrinking(J: Array) -> Array:
    """J^-T, which takes the far photograph's frequencies to the near one's."""
    M = inverse(J).T
    if np.linalg.norm(M, 2) >= 1:
        raise ValueError(f"the near photograph must be larger than the far one along every direction; got J = {J}")
    return M


def _waves(fx: Array, fy: Array, k: int, s: int) -> Complex:
    """Spectra at frequencies (n,) of unit samples at the k x k places, and of the tail: (n, k^2 + 1)."""
    x = (np.arange(k) - k // 2) / s
    ex, ey = np.exp(-2j * np.pi * fx[:, None] * x), np.exp(-2j * np.pi * fy[:, None] * x)
    inside = (ey[:, :, None] * ex[:, None, :]).reshape(len(fx), k * k)
    return np.hstack([inside, tail_spectrum(fx / s, fy / s, k)[:, None]])


def _samples(spectra: Complex, N: int, k: int) -> Array:
    """The central k x k samples (k^2, n) of n half-plane spectra (N (N/2 + 1), n)."""
    images = np.fft.irfft2(spectra.reshape(N, N // 2 + 1, -1), (N, N), axes=(0, 1))
    index = np.arange(-(k // 2), k // 2 + 1)
    return np.asarray(images[np.ix_(index, index)].reshape(k * k, -1))


def _stacked(rows: Complex) -> Array:
    """Real and imaginary parts of rows (n, p) as (2n, p)."""
    return np.vstack([rows.real, rows.imag])
