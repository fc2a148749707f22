"""The camera's PSF from the kernel between the two photographs, in the Fourier domain, with its derivative.

With x' = J x the map from far to near pixels, the kernel k and the PSF h are tied by K(f) = H(f) / H(J^-T f): the
near photograph contains the same optics, J times finer. J is a full matrix, so that a roll of the camera between the
photographs, and different zooms along x and y, are exact.

K is known at every frequency, including its tail beyond the support; so is the product H. The resulting PSF, samples
and tail, is the one whose spectrum is nearest to H.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.linalg

from procedures.numerics.arrays import Array, Complex
from procedures.numerics.kernel_tail import SHAPES, tail_spectra, tail_sums
from procedures.numerics.warps import inverse

CONVERGENCE_TOLERANCE = 1e-4
"""The product ends with the first factor that differs from 1 by less everywhere in the band."""
MAX_FACTORS = 40
TAIL = len(SHAPES)
CLOSE, FINER = 4, 4  # range of low frequencies, in steps of their grid, that is sampled more finely, and by what factor
RIM, RIM_WEIGHT = 0.4, 0.05  # cycles per sample from which frequencies have a lower weight, and that weight
EXACT = 1e3  # weight of the equation of the sum: exact compared with the others, which are of order 1


@dataclass(frozen=True)
class Recovered:
    """A PSF with its derivative by the kernel.

    parameters : (k^2 + q,), samples on the kernel's grid and support, and amplitudes of the tail
    derivative : (k^2 + q, k^2 + q), derivatives of the parameters by those of the kernel
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

    Raises ValueError if J does not enlarge: the product would not converge.

    total : (k^2 + q,), inter-image kernel on the s grid, and amplitudes of its tail
    s : samples per far pixel
    J : (2, 2), d(near pixels x, y) / d(far pixels x, y); it must enlarge

    Source: Delbracio, Almansa, Muse, IPOL 2013, section 4.4; thesis, Proposition 4. The factors beyond the first are
    normalised at f = 0, where a gain would be raised to their number.
    """
    M = _shrinking(J)
    values: list[Complex] = []
    slopes: list[Complex] = []
    gain, ones, k = gain_of(total), _sums(_side(total)), _side(total)
    for _ in range(MAX_FACTORS):
        wave = _waves(fx, fy, k, s)
        value = wave @ total / (gain if values else 1.0)
        slopes.append(np.asarray((wave - np.outer(value, ones)) / gain if values else wave))
        values.append(value)
        if len(values) > 1 and np.abs(values[-1] - 1).max() < CONVERGENCE_TOLERANCE:
            break
        fx, fy = M[0, 0] * fx + M[0, 1] * fy, M[1, 0] * fx + M[1, 1] * fy
    H = np.prod(values, axis=0)
    dH = sum(np.prod(values[:n] + values[n + 1 :], axis=0)[:, None] * slopes[n] for n in range(len(values)))
    return np.asarray(H), np.asarray(dH)


def psf_by_recursion(total: Array, s: int, J: Array) -> Recovered:
    """The PSF, samples and tail, nearest to H of `otf_by_recursion` over the band; parameters as there.

    Least squares over a grid of frequencies that resolves the tail, with more of them near 0, which determine it; the
    sum is that of H exactly.
    """
    k = _side(total)
    fx, fy, _ = _band(k)
    H, dH = otf_by_recursion(total, s, J, s * fx, s * fy)
    A, factor = _nearest(k)
    both = np.column_stack([H, dH])
    right = A.real.T @ both.real + A.imag.T @ both.imag
    right += EXACT**2 * np.outer(_sums(k), np.concatenate([[gain_of(total)], _sums(k)]))
    solution = scipy.linalg.cho_solve(factor, right, check_finite=False)
    return Recovered(np.asarray(solution[:, 0]), np.asarray(solution[:, 1:]))


def band(k: int, s: int) -> tuple[Array, Array]:
    """Frequencies (x, y) in cycles/pixel at which `nearest` requires a spectrum."""
    fx, fy, _ = _band(k)
    return s * fx, s * fy


def nearest(change: Complex, k: int) -> Array:
    """Parameters (k^2 + q,) of sum 0 nearest to a change of the spectrum at the frequencies of `band`."""
    A, factor = _nearest(k)
    right = A.real.T @ change.real + A.imag.T @ change.imag
    return np.asarray(scipy.linalg.cho_solve(factor, right, check_finite=False))


def psf_by_equation(total: Array, s: int, J: Array) -> Recovered:
    """The PSF as the least-squares solution of H(f) - K(f) H(J^-T f) = 0 under equal sums: a check of the recursion.

    Here h itself has the k x k support and the tail, in the recursion only the kernel. Parameters as there.
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
    """Gain between the photographs: the sum of kernel and infinite tail (k^2 + q,)."""
    return float(_sums(_side(total)) @ total)


def _side(total: Array) -> int:
    return math.isqrt(len(total) - TAIL)


def _sums(k: int) -> Array:
    """Spectra of unit samples and tails at f = 0, (k^2 + q,)."""
    return np.concatenate([np.ones(k * k), tail_sums(k)])


@lru_cache(maxsize=4)
def _band(k: int) -> tuple[Array, Array, Array]:
    """Frequencies (x, y) of the half band in cycles per sample, and their weights.

    The numbers depend on low frequencies, where the kernel is known best. At the band's edge the OTF may end with a
    step, whose ringing outside the support no tail can represent.
    """
    N = 2 * int(1.3 * k)
    fx, fy = _half_plane(N, 1)
    step = 1 / (FINER * N)
    close = np.arange(-FINER * CLOSE, FINER * CLOSE + 1) * step
    close_x, close_y = (f.ravel() for f in np.meshgrid(close[FINER * CLOSE :], close))
    coarse = np.maximum(np.abs(fx), np.abs(fy)) > (CLOSE + 0.5) / N
    x, y = np.concatenate([fx[coarse], close_x]), np.concatenate([fy[coarse], close_y])
    area = np.concatenate([np.ones(coarse.sum()), np.full(len(close_x), FINER**-2.0)])
    area[x == 0] /= 2  # both frequencies of an opposite pair are included
    rim = np.where(np.maximum(np.abs(x), np.abs(y)) > RIM, RIM_WEIGHT, 1.0)
    return x, y, area * rim / np.maximum(np.hypot(x, y), 1 / N)


@lru_cache(maxsize=4)
def _nearest(k: int) -> tuple[Complex, tuple[Array, bool]]:
    """Weighted spectra of unit parameters over the band, and the factor of the normal equations with the sum."""
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
    """J^-T, from the far photograph's frequencies to the near one's."""
    M = inverse(J).T
    if np.linalg.norm(M, 2) >= 1:
        raise ValueError(f"the near photograph must be larger than the far one along every direction; got J = {J}")
    return M


def _waves(fx: Array, fy: Array, k: int, s: int) -> Complex:
    """Spectra at frequencies (n,) of k x k unit samples and of the tail's shapes: (n, k^2 + q)."""
    x = (np.arange(k) - k // 2) / s
    ex, ey = np.exp(-2j * np.pi * fx[:, None] * x), np.exp(-2j * np.pi * fy[:, None] * x)
    inside = (ey[:, :, None] * ex[:, None, :]).reshape(len(fx), k * k)
    return np.hstack([inside, tail_spectra(fx / s, fy / s, k)])


def _stacked(rows: Complex) -> Array:
    return np.vstack([rows.real, rows.imag])
