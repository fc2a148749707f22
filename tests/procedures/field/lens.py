"""A simulated lens over its frame, fast: PSFs from the pupil by discrete Fourier transforms, nodes with noise."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import fft

from procedures.numerics.kernel_tail import tail_kernels
from procedures.pattern_psf.centre import mark_offset
from procedures.psf import Psf
from procedures.psf_field import Node
from simulators.camera.camera import Lens

S, K = 4, 17
SHAPE = (500, 750)  # rows, columns of a plane
WAVELENGTHS_UM = {"R": 0.6, "G1": 0.53, "G2": 0.53, "B": 0.46}
LENS = Lens(
    f_number=2.8, coma_um=0.10, astigmatism_um=0.12, field_curvature_um=0.10, axis=(0.08, -0.05), lateral_colour=0.006
)
PERIOD = 72
"""Period of the whole PSF in pixels of the plane: the energy beyond is a thousandth."""
NEAR = 36
"""A shorter period where the far tail is negligible, as for the position of marks: a fifth of the work."""
LAGS = 12
"""Points of the pupil's plane per pixel of the period: its widest diameter plus the highest frequency."""


@dataclass(frozen=True)
class FieldCamera:
    """A lens over planes whose pixels have a pitch; the photosites of a plane fill half of its pixels' sides."""

    lens: Lens = LENS
    pitch_um: float = 11.88
    period_px: int = PERIOD

    def psf(self, x: float, y: float, plane: str = "G1", defocus_um: float = 0.0) -> np.ndarray:
        """The PSF's support (K, K) of sum 1 at a place of the plane, centred on the marks."""
        return _support(self.whole(x, y, plane, defocus_um))

    def whole(self, x: float, y: float, plane: str = "G1", defocus_um: float = 0.0) -> np.ndarray:
        """The whole PSF (n, n) of sum 1, n even, its centre at n // 2."""
        return _centred(self.lens, self.field(x, y), WAVELENGTHS_UM[plane], self.pitch_um, defocus_um, self.period_px)

    def parameters(self, x: float, y: float, plane: str = "G1", defocus_um: float = 0.0) -> np.ndarray:
        """Support and amplitudes of the tail's shapes, (p,), fitted to the whole PSF."""
        whole = self.whole(x, y, plane, defocus_um)
        support = _crop(whole, K)
        outside, to_tail = _tail_fit()
        tail = to_tail @ _crop(whole, len(outside))[outside]
        return np.concatenate([support.ravel(), tail]) / support.sum()

    def mtf(self, x: float, y: float, f: np.ndarray, angle: float, defocus_um: float = 0.0) -> np.ndarray:
        """|OTF| of the whole PSF at frequencies (n,) along a direction."""
        whole = self.whole(x, y, defocus_um=defocus_um)
        at = (np.arange(len(whole)) - len(whole) // 2) / S
        ex, ey = (np.exp(-2j * np.pi * np.outer(f * turn, at)) for turn in (np.cos(angle), np.sin(angle)))
        return np.abs(np.sum((ey.real @ whole + 1j * (ey.imag @ whole)) * ex, axis=1))

    def lens_mtf(self, x: float, y: float, f: float, angle: float, defocus_um: npt.ArrayLike) -> np.ndarray:
        """|OTF| of the lens alone at a frequency, for defocuses (n,): the pupil's overlap with itself, summed."""
        wavelength = WAVELENGTHS_UM["G1"]
        shift = f * wavelength * self.lens.f_number / self.pitch_um * np.array([np.cos(angle), np.sin(angle)])
        u = (np.arange(-100, 100) + 0.5) / 100
        px, py = np.meshgrid(u, u)
        first, second = ((px + side * shift[0], py + side * shift[1]) for side in (1, -1))
        both = (np.hypot(*first) < 1) & (np.hypot(*second) < 1)
        first, second = ((a[both], b[both]) for a, b in (first, second))
        wavefront = self.lens.wavefront(*self.field(x, y))
        path = wavefront.at(*first) - wavefront.at(*second)
        of_defocus = 2 * 3**0.5 * (first[0] ** 2 + first[1] ** 2 - second[0] ** 2 - second[1] ** 2)
        waves = [(path + one * of_defocus) / wavelength for one in np.asarray(defocus_um)]
        return np.array([abs(np.exp(2j * np.pi * one).sum()) for one in waves]) / np.sum(np.hypot(px, py) < 1)

    @lru_cache(maxsize=500)  # noqa: B019  # a few cameras, for every map of theirs
    def numbers(self, x: float, y: float, radius: float) -> np.ndarray:
        """True `field.maps.numbers_of`; `radius` is the direction from the frame's centre."""
        mtf50 = []
        for angle in (radius + np.pi / 2, radius):
            coarse = np.linspace(0, S / 2, 41)
            i = int(np.flatnonzero(self.mtf(x, y, coarse, angle) < 0.5)[0])
            f = np.linspace(coarse[i - 1], coarse[i], 21)
            mtf50.append(_half(f, self.mtf(x, y, f, angle)))
        whole = self.whole(x, y)
        power = np.abs(np.fft.fft2(whole)) ** 2
        f = np.abs(np.fft.fftfreq(len(whole))) * S
        share = np.where(np.isclose(f, 0.5), 0.5, f < 0.5)  # the trapezoidal rule's half at the square's rim
        return np.array([
            *mtf50, mtf50[0] - mtf50[1], 1 - np.sum(share * share[:, None] * power) / np.sum(power),
            1 - _crop(whole, K).sum(),
        ])  # fmt: skip

    def field(self, x: float, y: float) -> tuple[float, float]:
        rows, columns = SHAPE
        half = np.hypot(rows, columns) / 2
        return float((x - (columns - 1) / 2) / half), float((y - (rows - 1) / 2) / half)

    def position(self, x: float, y: float, plane: str) -> np.ndarray:
        """Position in another plane of a chart at (x, y) in green: lateral colour, and the PSF's shape."""
        q = self.field(x, y)
        half = np.hypot(*SHAPE) / 2
        chief = self.lens.lateral_colour * (WAVELENGTHS_UM[plane] - 0.53) * half * (np.array(q) - self.lens.axis)
        marks = [_uncentred(self.lens, q, WAVELENGTHS_UM[p], self.pitch_um, 0.0, NEAR)[1] for p in (plane, "G1")]
        return np.array([x, y]) + chief + marks[0] - marks[1]


@lru_cache
def _tail_fit() -> tuple[np.ndarray, np.ndarray]:
    """Mask of the samples outside the support, and the least-squares matrix to the tail's amplitudes."""
    kernels = tail_kernels(K)
    outside = kernels[0] > 0
    weight = kernels[0][outside] ** -0.5  # a chart integrates over areas, near and far alike
    return outside, np.linalg.pinv((kernels[:, outside] * weight).T) * weight


def _half(f: np.ndarray, mtf: np.ndarray) -> float:
    """First crossing of one half."""
    i = int(np.flatnonzero(mtf < 0.5)[0])
    return float(np.interp(0.5, mtf[[i, i - 1]], f[[i, i - 1]]))


def _crop(whole, side):
    low = len(whole) // 2 - side // 2
    return whole[low : low + side, low : low + side]


def _support(whole):
    h = _crop(whole, K)
    return h / h.sum()


def _autocorrelation(pupil, most):
    """At lags from -most to most - 1 along both axes, 0 first."""
    n = LAGS * most * 2 // S
    power = np.abs(fft.fft(fft.fft(pupil, n, axis=1), n, axis=0)) ** 2
    right = fft.fft(fft.rfft(power, axis=1)[:, : most + 1], axis=0).conj()
    rows = right[np.r_[0 : most + 1, -most:0]].astype(np.complex128)
    left = np.roll(rows[::-1, most:0:-1], 1, axis=0).conj()  # lags opposite to those on the right
    return np.hstack([rows[:, :most], left])[np.r_[0:most, most + 1 : 2 * most + 1]]


@lru_cache(maxsize=2000)
def _uncentred(lens, q, wavelength_um, pitch_um, defocus_um, period):
    n = period * S
    cutoff = pitch_um / (wavelength_um * lens.f_number)  # cycles per pixel, = pupil diameter
    # pupil plane sampled at the frequencies of a period: unweighted points, off the centre, give the overlap of round
    # pupils to 4e-5; an averaged rim would count too little where a pupil overlaps itself
    reach = int(period * cutoff / 2) + 1
    u = (np.arange(-reach, reach + 1) + 0.31) / period / (cutoff / 2)
    x, y = np.meshgrid(u, u)
    inside = np.hypot(x, y) < 1
    x, y = x[inside], y[inside]
    wavefront = lens.wavefront(*q)
    path = wavefront.at(x, y) + defocus_um * 3**0.5 * (2 * (x * x + y * y) - 1)
    pupil = np.zeros(inside.shape, np.complex64)  # single precision gives the overlap to 1e-6
    pupil[inside] = np.exp(-2j * np.pi * path / wavelength_um)
    otf = _autocorrelation(pupil, n // 2)
    otf /= otf[0, 0]
    f = np.fft.fftfreq(n) * S
    pixel = np.sinc(0.5 * f) * np.cos(np.pi * f * 0.4) * np.exp(-2 * (np.pi * 0.15 * f) ** 2)
    otf = otf * pixel * pixel[:, None]
    whole = np.fft.fftshift(np.fft.ifft2(otf).real)
    return otf, mark_offset(_support(whole), S, np.eye(2))


@lru_cache(maxsize=2000)
def _centred(lens, q, wavelength_um, pitch_um, defocus_um, period):
    """Shifted, like an estimate, until the marks are at the centre."""
    otf, mark = _uncentred(lens, q, wavelength_um, pitch_um, defocus_um, period)
    f = np.fft.fftfreq(len(otf)) * S
    shift = mark
    for _ in range(6):
        phase = np.exp(2j * np.pi * f * shift[0]) * np.exp(2j * np.pi * f * shift[1])[:, None]
        whole = np.fft.fftshift(np.fft.ifft2(otf * phase).real)
        step = mark_offset(_support(whole), S, np.eye(2))
        shift = shift + step
        if np.abs(step).max() < 1e-6:
            break
    return whole


def grid(columns: int = 5, rows: int = 5, margin: float = 0.12) -> np.ndarray:
    """Places (n, 2) in pixels of the plane."""
    x = np.linspace(margin, 1 - margin, columns) * (SHAPE[1] - 1)
    y = np.linspace(margin, 1 - margin, rows) * (SHAPE[0] - 1)
    return np.array([(a, b) for b in y for a in x])


def nodes(camera: FieldCamera, places, covariance, rng, plane="G1", defocus_um=0.0, centre_px=0.003) -> list[Node]:
    """Simulated measurements: true PSFs with noise of that covariance (p, p), at places known to `centre_px`."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))
    measured = []
    for number, (x, y) in enumerate(places):
        p = camera.parameters(x, y, plane, defocus_um) + root @ rng.standard_normal(len(root))
        at = camera.position(x, y, plane) + centre_px * rng.standard_normal(2)
        psf = Psf.of(p, covariance, K, S)
        measured.append(Node(at, centre_px**2 * np.eye(2), 2 * at, psf, "simulated", number))
    return measured
