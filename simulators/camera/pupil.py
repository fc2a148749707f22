"""Transfer functions of a circular pupil: the closed form without aberrations, quadrature with them.

A shift of 2 (pupil radii) is the cutoff. The wavefront is a sum of Noll's orthonormal Zernike polynomials.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, RectBivariateSpline

from procedures.numerics.compiled import compiled


@compiled
def read(table: Complex, sx: Array, sy: Array) -> Complex:
    """The function at shifts (sx, sy), flat, by the cubic through four values along both axes; 0 from 2 on.

    table : (rows, 1) or (rows, turn + 3) complex128
        Along rows t from 0 to 1, shift = 2 (1 - t^2). Along columns nothing, or the angle from -pi on in equal steps,
        `turn` of them to the turn, with one column more before them and two after.
    """
    rows, turn = table.shape[0], table.shape[1] - 3
    out = np.zeros(sx.size, np.complex128)
    for i in range(sx.size):
        shift = np.hypot(sx[i], sy[i])
        if shift >= 2:
            continue
        t = np.sqrt(1 - shift / 2) * (rows - 1)
        first = min(max(int(t) - 1, 0), rows - 4)
        if turn < 0:
            for m, weight in enumerate(through_four(t - first)):
                out[i] += weight * table[first + m, 0]
            continue
        a = (np.arctan2(sy[i], sx[i]) / (2 * np.pi) + 0.5) * turn
        left = min(int(a), turn - 1)
        p, q, r, s = through_four(a - left + 1)
        for m, weight in enumerate(through_four(t - first)):
            row = table[first + m]
            out[i] += weight * (p * row[left] + q * row[left + 1] + r * row[left + 2] + s * row[left + 3])
    return out


@compiled
def through_four(x: float) -> tuple[float, float, float, float]:
    """Lagrange's weights of values at 0, 1, 2 and 3 for the value at x."""
    a, b, c, d = x, x - 1, x - 2, x - 3
    return -b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6


Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]


FINER = 4  # tabulated values per integrated one: evaluating splines at every frequency is too slow


@dataclass(frozen=True)
class Wavefront:
    """Optical path differences over the pupil: root mean square of each aberration, in micrometres.

    Defocus, astigmatism along the axes and at 45 degrees, coma in y and in x, spherical: Noll's polynomials 4, 6, 5,
    7, 8, 11. Positive coma in x extends the tail towards +x.
    """

    defocus_um: float = 0.0
    astigmatism_um: float = 0.0
    oblique_astigmatism_um: float = 0.0
    coma_y_um: float = 0.0
    coma_x_um: float = 0.0
    spherical_um: float = 0.0

    @property
    def flat(self) -> bool:
        """Whether there is no aberration at all."""
        return not any(astuple(self))

    @property
    def round(self) -> bool:
        """Whether it is rotationally symmetric."""
        return self == Wavefront(defocus_um=self.defocus_um, spherical_um=self.spherical_um)

    def __add__(self, other: Wavefront) -> Wavefront:
        return Wavefront(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def steepest_um(self) -> float:
        """A bound of the path difference's slope per pupil radius: that of each polynomial at the rim, added."""
        sizes = np.abs(astuple(self))
        # largest |gradient| on the unit disc of 2 r^2 - 1, r^2 cos 2a, 3 r^3 cos a - 2 r cos a, 6 r^4 - 6 r^2
        return float(sizes @ [4 * 3**0.5, 2 * 6**0.5, 2 * 6**0.5, 7 * 8**0.5, 7 * 8**0.5, 12 * 5**0.5])

    def at(self, x: Array, y: Array) -> Array:
        """Path difference in micrometres at points of the unit pupil."""
        r2 = x * x + y * y
        return (
            self.round_at(r2)
            + self.astigmatism_um * 6**0.5 * (x * x - y * y)
            + self.oblique_astigmatism_um * 6**0.5 * 2 * x * y
            + (self.coma_x_um * x + self.coma_y_um * y) * 8**0.5 * (3 * r2 - 2)
        )

    def round_at(self, r2: Array) -> Array:
        """Its rotationally symmetric part at squared distances from the pupil's centre."""
        defocus, spherical = self.defocus_um * 3**0.5, self.spherical_um * 5**0.5
        return defocus * (2 * r2 - 1) + spherical * (6 * r2 * r2 - 6 * r2 + 1)


def defocus_um(focus_shift_mm: float, f_number: float) -> float:
    """Defocus, as defined by `Wavefront`, of a sensor `focus_shift_mm` away from the sharp image.

    The path differs by shift / (8 N^2) between centre and rim, of which 1 / (2 sqrt 3) is the root mean square.
    """
    return 1000 * focus_shift_mm / (8 * f_number**2) / (2 * 3**0.5)


def circular_otf(shift: Array) -> Array:
    """Overlap of two unit discs whose centres are `shift` apart, over pi; 0 from 2 on."""
    half = np.minimum(shift / 2, 1.0)
    otf: Array = 2 / np.pi * (np.arccos(half) - half * np.sqrt(1 - half * half))
    return otf


def aberrated_otf(sx: Array, sy: Array, wavefront: Wavefront, wavelength_um: float) -> Array | Complex:
    """Autocorrelation of the aberrated pupil at shifts (sx, sy) in pupil radii, broadcast; real for a round one."""

    if wavefront.round and sy.ndim == 2 and sy.shape[1] == 1:  # a symmetric grid
        sy, below = np.unique(np.abs(sy), return_inverse=True)
        sy = sy[:, None]
    else:
        below = None
    sx, sy = np.broadcast_arrays(sx, sy)
    table = (_profile if wavefront.round else _turned)(wavefront, wavelength_um)
    otf = read(table, sx.ravel(), sy.ravel()).reshape(sx.shape)
    if below is not None:
        otf = otf[below.ravel()]
    return np.asarray(otf.real) if wavefront.round else otf


@lru_cache(maxsize=64)
def _profile(wavefront: Wavefront, wavelength_um: float) -> Complex:
    """The OTF of a round wavefront over t, (rows, 1), as `read` reads it."""
    n, quadrature = _fineness(wavefront, wavelength_um)
    t = np.linspace(0.0, 1.0, 3 * n)
    # `_overlap` at many shifts of a round wavefront, over a quarter of the lens: the path difference is even across
    # the shift and odd along it, so that the cosine remains
    shifts = 2 * (1 - t * t)
    nodes, weights = quadrature
    half = nodes >= 0  # the nodes are symmetric; a middle one counts once
    nodes, weights = nodes[half], np.where(nodes > 0, 2.0, 1.0)[half] * weights[half]
    area, along, across = _lens(shifts, nodes, weights)
    apart, r2 = shifts[:, None, None] / 2, across * across
    behind, ahead = (wavefront.round_at(x * x + r2) for x in (along - apart, along + apart))
    otf: Array = np.sum(area * np.cos(2 * np.pi / wavelength_um * (behind - ahead)), axis=(1, 2)) / np.pi
    fine: Array = CubicSpline(t, otf)(np.linspace(0.0, 1.0, 3 * n * FINER))
    return fine[:, None].astype(np.complex128)


def _fineness(wavefront: Wavefront, wavelength_um: float) -> tuple[int, tuple[Array, Array]]:
    """Number of spline nodes along t, and the quadrature.

    Measured against 160 nodes and no spline: errors below 4e-6 at 0.2 waves, 2e-5 at 1.1 waves.
    """
    waves = float(np.linalg.norm(astuple(wavefront))) / wavelength_um
    return 48 + int(40 * waves), np.polynomial.legendre.leggauss(20 + int(36 * waves))


@lru_cache(maxsize=16)
def _turned(wavefront: Wavefront, wavelength_um: float) -> Complex:
    """The OTF over t and angle, as `read` reads it: in t it is smooth up to the cutoff."""
    n, quadrature = _fineness(wavefront, wavelength_um)
    t = np.linspace(0.0, 1.0, 3 * n)
    angles = np.arange(n) * np.pi / n
    half = np.array([_overlap(2 * (1 - a * a), angles, wavefront, wavelength_um, quadrature) for a in t])
    # opposite frequencies are conjugate; eight angles more on either side keep the spline's ends out of use
    values = np.concatenate([half[:, -8:], half.conj(), half, half[:, :8].conj()], axis=1)
    around = np.arange(-n - 8, n + 8) * np.pi / n
    turn = 2 * n * FINER
    where = np.linspace(0.0, 1.0, 3 * n * FINER), np.pi * (2 * np.arange(-1, turn + 2) / turn - 1)
    real, imaginary = (RectBivariateSpline(t, around, part, s=0)(*where) for part in (values.real, values.imag))
    return np.asarray(real + 1j * imaginary, dtype=np.complex128)


def _overlap(
    shift: float, angles: Array, wavefront: Wavefront, wavelength_um: float, quadrature: tuple[Array, Array]
) -> Complex:
    """The autocorrelation at one shift and many directions, by Gauss-Legendre quadrature over the lens of overlap."""
    area, along, across = _lens(shift, *quadrature)
    c, s = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    ahead, behind = along + shift / 2, along - shift / 2
    paths = [wavefront.at(c * x - s * across, s * x + c * across) for x in (ahead, behind)]
    phase = np.exp(2j * np.pi / wavelength_um * (paths[1] - paths[0]))
    return np.asarray(np.sum(area * phase, axis=(1, 2)) / np.pi, dtype=np.complex128)


def _lens(shift: float | Array, nodes: Array, weights: Array) -> tuple[Array, Array, Array]:
    """The lens in which two discs overlap: area of each node, its positions along and across the shift, after the
    axes of `shift`.

    Along the shift the lens reaches to a = sqrt(1 - y^2) - shift / 2 on both sides, across it to
    b = sqrt(1 - shift^2 / 4); y = b sin(phi) removes the square roots at the ends.
    """
    half = np.asarray(shift)[..., None] / 2
    b = np.sqrt(1 - half * half)
    phi = nodes * np.pi / 2
    y = b * np.sin(phi)
    a = np.maximum(np.sqrt(1 - y * y) - half, 0.0)
    area = (weights * np.pi / 2 * b * np.cos(phi) * a)[..., None] * weights
    return area, a[..., None] * nodes, y[..., None]
