"""Edges rendered from analytic OTFs, without a finite PSF and without a periodic Fourier transform.

The edge spread function of an OTF H along the edge's normal is 1/2 + the integral of the imaginary part of
H(f) exp(2 pi i f d) / (pi f) over f > 0, evaluated at the pixels' centres. Shares no code with the estimator and the
simulated camera.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from procedures.raw import Plane

from ..pattern_psf.analytic_camera import circular

Array = npt.NDArray[np.float64]

BLACK, WHITE = 0.08, 0.8
APART_PX = 0.02
HIGHEST = 12.0
"""Cycles per pixel up to which an OTF without a cutoff is integrated."""


@dataclass(frozen=True)
class Camera:
    """A clear circular pupil, square pixels of a fill factor, and a Gaussian blur, in pixels and cycles per pixel.

    `cutoff` is infinite without diffraction. `sharpening` is the amount of an unsharp mask of radius `halo_px`
    (standard deviation), applied to the light.
    """

    cutoff: float = np.inf
    fill: float = 1.0
    blur_px: float = 0.0
    sharpening: float = 0.0
    halo_px: float = 1.0

    def otf(self, f: Array, angle_deg: float) -> Array:
        """OTF along the normal of an edge at an angle from the columns."""
        x, y = f * np.cos(np.radians(angle_deg)), f * np.sin(np.radians(angle_deg))
        mask = 1 + self.sharpening * (1 - np.exp(-2 * (np.pi * f * self.halo_px) ** 2))
        return np.asarray(circular(self.cutoff, fill=self.fill, blur_px=self.blur_px)(x, y) * mask)

    def mtf50(self, angle_deg: float) -> float:
        """Frequency at which |OTF| first falls to one half."""
        f = np.linspace(0, 2, 20001)
        mtf = np.abs(self.otf(f, angle_deg))
        i = int(np.flatnonzero(mtf < 0.5)[0])
        return float(f[i - 1] + (mtf[i - 1] - 0.5) / (mtf[i - 1] - mtf[i]) * (f[1] - f[0]))

    @classmethod
    def of_mtf50(cls, mtf50: float, **others: float) -> Camera:
        """Camera whose Gaussian blur gives this MTF50 at 5 degrees, with any other parameters."""
        low, high = 0.0, 3.0
        for _ in range(50):
            middle = (low + high) / 2
            low, high = (middle, high) if cls(blur_px=middle, **others).mtf50(5.0) > mtf50 else (low, middle)
        return cls(blur_px=low, **others)


def spread(otf: Callable[[Array], Array], reach_px: float) -> tuple[Array, Array]:
    """Distances and the edge spread function there, 0 dark and 1 bright.

    The period of the sum is thirty-two times the reach.
    """
    count = 2 ** int(np.ceil(np.log2(32 * reach_px / APART_PX)))
    step = 1 / (count * APART_PX)
    f = (np.arange(int(HIGHEST / step)) + 0.5) * step
    d = np.arange(int(np.ceil(reach_px / APART_PX)) + 1) * APART_PX
    H = otf(f)
    half = np.exp(1j * np.pi * step * d)
    rise, fall = (
        np.imag(half * np.fft.ifft(one / (np.pi * f) * step, count)[: len(d)] * count) for one in (H, np.conj(H))
    )
    return np.concatenate([-d[:0:-1], d]), 0.5 + np.concatenate([-fall[:0:-1], rise])


def edge(camera: Camera, *, rows: int = 100, columns: int = 60, angle_deg: float = 5.0, shift_px: float = 0.0) -> Array:
    """Light on the pixels, bright on the right, (rows, columns), from `BLACK` to `WHITE`."""
    y, x = np.mgrid[:rows, :columns]
    lean = np.radians(angle_deg)
    d = (x - (columns - 1) / 2 - shift_px) * np.cos(lean) - (y - (rows - 1) / 2) * np.sin(lean)
    places, values = spread(lambda f: camera.otf(f, angle_deg), float(np.abs(d).max()) + 1)
    return np.asarray(BLACK + (WHITE - BLACK) * CubicSpline(places, values)(d))


def photograph(light: Array, rng: np.random.Generator, noise: float = 0.004) -> Plane:
    """The light with photon and read noise, `noise` at white, rounded to 14 bits, as a RAW file has it."""
    spread_of = noise * np.sqrt(0.1 + 0.9 * np.maximum(light, 0) / WHITE)
    counts = np.rint((light + spread_of * rng.standard_normal(light.shape)) * 16383)
    return Plane("Y", (counts / 16383).astype(np.float32), 1 / 16383, raw=True)
