"""A simulated lens over its frame, fast: PSFs from the pupil by discrete Fourier transforms, nodes with noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from procedures.pattern_psf.centre import mark_offset
from procedures.psf import Psf
from procedures.psf_field import Node
from simulators.camera import Lens

S, K = 4, 17
SHAPE = (500, 750)  # rows, columns of a plane
WAVELENGTHS_UM = {"R": 0.6, "G1": 0.53, "G2": 0.53, "B": 0.46}
LENS = Lens(
    f_number=2.8,
    coma_um=0.10,
    astigmatism_um=0.12,
    field_curvature_um=0.10,
    axis=(0.08, -0.05),
    lateral_colour=0.006,
)
PERIOD = 24  # pixels of the plane after which the PSF repeats


@dataclass(frozen=True)
class FieldCamera:
    """A lens over planes whose pixels have a pitch; the photosites of a plane fill half of its pixels' sides."""

    lens: Lens = LENS
    pitch_um: float = 11.88

    def psf(self, x: float, y: float, plane: str = "G1", defocus_um: float = 0.0) -> np.ndarray:
        """The PSF (K, K) of sum 1 at a place of the plane, its centre where the marks are seen."""
        q = self.field(x, y)
        return _psf(self.lens, q, WAVELENGTHS_UM[plane], self.pitch_um, defocus_um)

    def field(self, x: float, y: float) -> tuple[float, float]:
        rows, columns = SHAPE
        half = np.hypot(rows, columns) / 2
        return float((x - (columns - 1) / 2) / half), float((y - (rows - 1) / 2) / half)

    def position(self, x: float, y: float, plane: str) -> np.ndarray:
        """Where a chart that green shows at (x, y) is seen in another plane: lateral colour, and the PSF's shape."""
        q = np.array(self.field(x, y)) - self.lens.axis
        half = np.hypot(*SHAPE) / 2
        chief = self.lens.lateral_colour * (WAVELENGTHS_UM[plane] - 0.53) * half * q
        marks = [
            _uncentred(self.lens, self.field(x, y), WAVELENGTHS_UM[p], self.pitch_um, 0.0)[1] for p in (plane, "G1")
        ]
        return np.array([x, y]) + chief + marks[0] - marks[1]


@lru_cache(maxsize=2000)
def _uncentred(lens, q, wavelength_um, pitch_um, defocus_um):
    n, fine = PERIOD * S, 192
    cutoff = pitch_um / (wavelength_um * lens.f_number)  # cycles per pixel, = pupil diameter
    # pupil plane sampled at the frequencies of a period of PERIOD pixels, finely averaged at its rim
    u = (np.arange(fine) - fine // 2) / PERIOD / (cutoff / 2)
    x, y = np.meshgrid(u, u)
    inside = np.clip((1 - np.hypot(x, y)) * cutoff / 2 * PERIOD + 0.5, 0, 1)
    wavefront = lens.wavefront(*q)
    path = wavefront.at(x, y) + defocus_um * 3**0.5 * (2 * (x * x + y * y) - 1)
    pupil = inside * np.exp(-2j * np.pi * path / wavelength_um)
    otf = np.fft.ifft2(np.abs(np.fft.fft2(np.fft.ifftshift(pupil))) ** 2)
    keep = np.r_[0 : n // 2, -n // 2 : 0]
    f = np.fft.fftfreq(n) * S
    pixel = np.sinc(0.5 * f) * np.cos(np.pi * f * 0.4) * np.exp(-2 * (np.pi * 0.15 * f) ** 2)
    otf = otf[np.ix_(keep, keep)] * pixel * pixel[:, None]
    whole = np.fft.fftshift(np.fft.ifft2(otf).real)
    low = n // 2 - K // 2
    h = whole[low : low + K, low : low + K]
    h = h / h.sum()
    return otf, mark_offset(h, S, np.eye(2))


@lru_cache(maxsize=2000)
def _psf(lens, q, wavelength_um, pitch_um, defocus_um):
    """Shifted, as an estimate is, until the marks are at the centre."""
    otf, _ = _uncentred(lens, q, wavelength_um, pitch_um, defocus_um)
    n = len(otf)
    f = np.fft.fftfreq(n) * S
    shift = np.zeros(2)
    low = n // 2 - K // 2
    for _ in range(6):
        phase = np.exp(2j * np.pi * f * shift[0]) * np.exp(2j * np.pi * f * shift[1])[:, None]
        h = np.fft.fftshift(np.fft.ifft2(otf * phase).real)[low : low + K, low : low + K]
        h = h / h.sum()
        shift = shift + mark_offset(h, S, np.eye(2))
    return h


def grid(columns: int = 5, rows: int = 5, margin: float = 0.12) -> np.ndarray:
    """Places (n, 2) in pixels of the plane."""
    x = np.linspace(margin, 1 - margin, columns) * (SHAPE[1] - 1)
    y = np.linspace(margin, 1 - margin, rows) * (SHAPE[0] - 1)
    return np.array([(a, b) for b in y for a in x])


def nodes(camera: FieldCamera, places, covariance, rng, plane="G1", defocus_um=0.0, centre_px=0.003) -> list[Node]:
    """What would be measured: the true PSFs with noise of that covariance, at places known to `centre_px`."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))
    found = []
    for number, (x, y) in enumerate(places):
        noise = (root @ rng.standard_normal(K * K)).reshape(K, K)
        psf = Psf(camera.psf(x, y, plane, defocus_um) + noise, S, covariance)
        at = camera.position(x, y, plane) + centre_px * rng.standard_normal(2)
        found.append(Node(at, centre_px**2 * np.eye(2), 2 * at, psf, "simulated", number))
    return found
