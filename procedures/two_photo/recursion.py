"""From the kernel between the two photographs to the PSF of the camera, in Fourier, with the derivative of every step.

With x' = J x the map from far to near pixels, the kernel k and the PSF h are tied by K(f) = H(f) / H(J^-T f): the
near photograph holds the same optics, J times finer. J is kept whole, so that a roll of the camera between the two
photographs, and different zooms along x and y, are exact.

K is known at every frequency, its tail beyond the support included; so is the product H. The PSF that is handed on,
samples and tail, is the one whose spectrum is nearest to H.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy.linalg

from procedures.numerics.kernel_tail import SHAPES, tail_spectra, tail_sums
from procedures.numerics.warps import inverse

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

REST = 1e-4
"""The product ends with the first factor that nowhere in the band differs from 1 by more."""
MOST_FACTORS = 40
TAIL = len(SHAPES)
CLOSE, FINER = 4, 4
"""Steps of the grid of frequencies from 0 within which there are so many times more of them along either axis."""
RIM, RIM_WEIGHT = 0.4, 0.05
"""Cycles per sample from which frequencies count less, and how much they count."""
EXACT = 1e3
"""Weight of the light's equation: exact beside the others, which are of order 1."""


@dataclass(frozen=True)
class Recovered:
    """A PSF with its dependence on the kernel it came from.

    Attributes
    ----------
    parameters : (k^2 + q,) float64
        Its samples on the kernel's grid, inside its support, and the amplitudes of its tail.
    derivative : (k^2 + q, k^2 + q) float64
        Of the parameters by those of the kernel.
    """

    parameters: Array
    derivative: Array

    @property
    def h(self) -> Array:
        """The samples (k, k)."""
        k = _side(self.parameters)
        return self.parameters[: k * k].reshape(k, k)

    def covariance(self, of_kernel: Array) -> Array:
        """Covariance (k^2 + q, k^2 + q) of the parameters, from that of the kernel and its tail."""
        return np.asarray(self.derivative @ of_kernel @ self.derivative.T)


def otf_by_recursion(total: Array, s: int, J: Array, fx: Array, fy: Array) -> tuple[Complex, Complex]:
    """H(f) = K(f) K(J^-T f) K(J^-T J^-T f) ... at frequencies (n,) in cycles/pixel, and its derivative (n, k^2 + q).

    Parameters
    ----------
    total : (k^2 + q,) float64
        The inter-image kernel on the s grid and, last, the amplitudes of its tail beyond.
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
    M = _shrinking(J)
    values: list[Complex] = []
    slopes: list[Complex] = []
    gain, ones, k = gain_of(total), _sums(_side(total)), _side(total)
    for _ in range(MOST_FACTORS):
        wave = _waves(fx, fy, k, s)
        value = wave @ total / (gain if values else 1.0)
        slopes.append(np.asarray((wave - np.outer(value, ones)) / gain if values else wave))
        values.append(value)
        if len(values) > 1 and np.abs(values[-1] - 1).max() < REST:
            break
        fx, fy = M[0, 0] * fx + M[0, 1] * fy, M[1, 0] * fx + M[1, 1] * fy
    H = np.prod(values, axis=0)
    dH = sum(np.prod(values[:n] + values[n + 1 :], axis=0)[:, None] * slopes[n] for n in range(len(values)))
    return np.asarray(H), np.asarray(dH)


def psf_by_recursion(total: Array, s: int, J: Array) -> Recovered:
    """The PSF, samples and tail, nearest to H of `otf_by_recursion` over the band; parameters as there.

    Least squares over the frequencies of a grid that the tail's reach fits on, with more of them near 0, where the
    tail tells; its light is that of H exactly.
    """
    k = _side(total)
    fx, fy, _ = _band(k)
    H, dH = otf_by_recursion(total, s, J, s * fx, s * fy)
    A, factor = _nearest(k)
    both = np.column_stack([H, dH])
    right = A.real.T @ both.real + A.imag.T @ both.imag
    right += EXACT**2 * np.outer(_sums(k), np.concatenate([[gain_of(total)], _sums(k)]))
    found = scipy.linalg.cho_solve(factor, right, check_finite=False)
    return Recovered(np.asarray(found[:, 0]), np.asarray(found[:, 1:]))


def band(k: int, s: int) -> tuple[Array, Array]:
    """The frequencies (x, y) in cycles/pixel at which a spectrum is wanted by `nearest`."""
    fx, fy, _ = _band(k)
    return s * fx, s * fy


def nearest(change: Complex, k: int) -> Array:
    """The parameters (k^2 + q,) nearest to a change of the spectrum at the frequencies of `band`, of no light."""
    A, factor = _nearest(k)
    right = A.real.T @ change.real + A.imag.T @ change.imag
    return np.asarray(scipy.linalg.cho_solve(factor, right, check_finite=False))


def psf_by_equation(total: Array, s: int, J: Array) -> Recovered:
    """The PSF as the least-squares solution of H(f) - K(f) H(J^-T f) = 0 under equal sums: the recursion's check.

    Here h itself has the k x k support and the tail, in the recursion only the kernel has. Parameters as there.
    """
    k = _side(total)
    gain = gain_of(total)
    fx, fy = _half_plane(int(2 ** np.ceil(np.log2(2 * k))), s)
    M = _shrinking(J)
    here = _waves(fx, fy, k, s)
    there = _waves(M[0, 0] * fx + M[0, 1] * fy, M[1, 0] * fx + M[1, 1] * fy, k, s)
    K = here @ total / gain
    system = np.vstack([_stacked(np.asarray(here - K[:, None] * there)), EXACT * _sums(k)[None]])
    solution = np.linalg.pinv(system)
    h = solution[:, -1] * EXACT
    dK = (here - np.outer(K, _sums(k))) / gain
    derivative = solution[:, :-1] @ _stacked(np.asarray((there @ h)[:, None] * dK))
    return Recovered(np.asarray(gain * h), np.asarray(gain * derivative + np.outer(h, _sums(k))))


def gain_of(total: Array) -> float:
    """The gain between the photographs: the sum of kernel and tail (k^2 + q,), the tail taken without an end."""
    return float(_sums(_side(total)) @ total)


def _side(total: Array) -> int:
    """k, of k^2 samples and the tail's amplitudes."""
    return math.isqrt(len(total) - TAIL)


def _sums(k: int) -> Array:
    """Spectra of unit samples and tails at f = 0, (k^2 + q,)."""
    return np.concatenate([np.ones(k * k), tail_sums(k)])


@lru_cache(maxsize=4)
def _band(k: int) -> tuple[Array, Array, Array]:
    """Frequencies (x, y) of the half band in cycles per sample, and their weights.

    The numbers are read at low frequencies, and the kernel is best known there. At the band's edge the OTF may end
    with a step, whose ringing outside the support no tail can follow.
    """
    N = 2 * int(1.3 * k)
    fx, fy = _half_plane(N, 1)
    step = 1 / (FINER * N)
    close = np.arange(-FINER * CLOSE, FINER * CLOSE + 1) * step
    close_x, close_y = (f.ravel() for f in np.meshgrid(close[FINER * CLOSE :], close))
    coarse = np.maximum(np.abs(fx), np.abs(fy)) > (CLOSE + 0.5) / N
    x, y = np.concatenate([fx[coarse], close_x]), np.concatenate([fy[coarse], close_y])
    area = np.concatenate([np.ones(coarse.sum()), np.full(len(close_x), FINER**-2.0)])
    area[x == 0] /= 2  # both of a pair of opposite frequencies are there
    rim = np.where(np.maximum(np.abs(x), np.abs(y)) > RIM, RIM_WEIGHT, 1.0)
    return x, y, area * rim / np.maximum(np.hypot(x, y), 1 / N)


@lru_cache(maxsize=4)
def _nearest(k: int) -> tuple[Complex, tuple[Array, bool]]:
    """Weighted spectra of unit parameters over the band, and the factor of their normal equations, the light's too."""
    fx, fy, weight = _band(k)
    waves = _waves(fx, fy, k, 1)
    A = weight[:, None] * waves
    G = waves.real.T @ A.real + waves.imag.T @ A.imag + EXACT**2 * np.outer(_sums(k), _sums(k))
    return A, scipy.linalg.cho_factor(G, lower=True, check_finite=False)


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
    """Spectra at frequencies (n,) of unit samples at the k x k places, and of the tail's shapes: (n, k^2 + q)."""
    x = (np.arange(k) - k // 2) / s
    ex, ey = np.exp(-2j * np.pi * fx[:, None] * x), np.exp(-2j * np.pi * fy[:, None] * x)
    inside = (ey[:, :, None] * ex[:, None, :]).reshape(len(fx), k * k)
    return np.hstack([inside, tail_spectra(fx / s, fy / s, k)])


def _stacked(rows: Complex) -> Array:
    """Real and imaginary parts of rows (n, p) as (2n, p)."""
    return np.vstack([rows.real, rows.imag])
