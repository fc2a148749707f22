"""Photographs of the chart through optics whose PSF has no end: the scene's spectrum times an analytic OTF.

Shares nothing with the simulators or the estimator but the chart: the scene is drawn by area on a fine grid, multiplied
by the OTF in the Fourier domain, and read at the pixels' centres. Nothing is convolved with a PSF that was cut.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.fft
from scipy.optimize import brentq

from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, CELLS, X_CORNER_BLOCKS, Chart
from procedures.raw import Plane

Otf = Callable[[np.ndarray, np.ndarray], np.ndarray]


def circular(cutoff: float, *, fill: float = 1.0, blur_px: float = 0.0) -> Otf:
    """Diffraction of a clear circle, a square photosite of width `fill`, a Gaussian blur; cycles per pixel."""

    def otf(fx: np.ndarray, fy: np.ndarray) -> np.ndarray:
        v = np.clip(np.hypot(fx, fy) / cutoff, 0, 1)
        diffraction = 2 / np.pi * (np.arccos(v) - v * np.sqrt(1 - v * v))
        gaussian = np.exp(-2 * (np.pi * blur_px) ** 2 * (fx**2 + fy**2))
        return diffraction * np.sinc(fill * fx) * np.sinc(fill * fy) * gaussian

    return otf


def mtf50(otf: Otf, axis: int = 0) -> float:
    """MTF50 along x (0) or y (1)."""

    def less(f: float) -> float:
        at = np.array([f]), np.zeros(1)
        return float(abs(otf(*(at if axis == 0 else at[::-1]))[0])) - 0.5

    f = np.arange(0.005, 2, 0.005)
    i = int(np.argmax(np.array([less(one) for one in f]) < 0))
    return float(brentq(less, f[i - 1], f[i]))


@dataclass(frozen=True)
class View:
    """Pose of the chart: width of the noise region in pixels, roll, perspective, position."""

    width_px: float = 104.0
    roll: float = 0.03
    tilt: tuple[float, float] = (0.0, 0.0)
    shift_px: tuple[float, float] = (0.3, -0.2)
    size_px: int = 176

    def to_cells(self) -> np.ndarray:
        """Pixels about the frame's middle -> cells, (3, 3)."""
        scale, c, s = self.width_px / CELLS, np.cos(self.roll), np.sin(self.roll)
        H = np.array(
            [
                [c * scale, -s * scale, self.shift_px[0]],
                [s * scale, c * scale, self.shift_px[1]],
                [self.tilt[0] / CELLS, self.tilt[1] / CELLS, 1.0],
            ]
        )
        middle = np.array([[1, 0, -CELLS / 2], [0, 1, -CELLS / 2], [0, 0, 1.0]])
        return np.asarray(np.linalg.inv(H @ middle))


def light(otf: Otf, chart: Chart, view: View, *, fine: int = 8, points: int = 4) -> np.ndarray:
    """The chart's light at the pixels, black 0 and white 1, without noise.

    Parameters
    ----------
    fine : int
        Points of the Fourier grid per pixel and axis; it must hold the optics' whole band.
    points : int
        Of the area of each of them per axis.
    """
    n = view.size_px * fine
    scene = _scene(np.asarray(chart.cells, np.uint8).tobytes(), view, fine, points)
    fy, fx = scipy.fft.fftfreq(n, 1 / fine)[:, None], scipy.fft.rfftfreq(n, 1 / fine)[None]
    area = np.sinc(fx / fine) * np.sinc(fy / fine)
    to_centres = np.exp(2j * np.pi * (fx + fy) * (fine - 1) / (2 * fine))
    spectrum = scipy.fft.rfft2(scene) * (otf(fx, fy) / area * to_centres)
    return np.asarray(scipy.fft.irfft2(spectrum, (n, n))[::fine, ::fine])


@lru_cache(maxsize=2)
def _scene(printed: bytes, view: View, fine: int, points: int) -> np.ndarray:
    """The print of these cells by area on the Fourier grid: it is the same through all optics."""
    cells = np.frombuffer(printed, np.uint8).reshape(CELLS, CELLS)
    n = view.size_px * fine
    M = view.to_cells()
    place = (np.arange(n * points) + 0.5) / (fine * points) - 0.5 - (view.size_px - 1) / 2
    scene = np.empty((n, n), np.float32)
    for top in range(0, n, fine):
        x, y = place[None], place[top * points : (top + fine) * points, None]
        w = M[2, 0] * x + M[2, 1] * y + M[2, 2]
        ink = _ink(cells, (M[0, 0] * x + M[0, 1] * y + M[0, 2]) / w, (M[1, 0] * x + M[1, 1] * y + M[1, 2]) / w)
        scene[top : top + fine] = ink.reshape(fine, points, n, points).mean(axis=(1, 3))
    return scene


def _ink(cells: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The print at points in cells: white 1, black 0."""
    column, row = (np.clip(np.floor(one / BLOCK), -2, _LAST - 2).astype(np.intp) + 2 for one in (x, y))
    value = _LAYOUT[row, column]
    inside = (x >= 0) & (x < CELLS) & (y >= 0) & (y < CELLS)
    value[inside] = cells[y[inside].astype(int), x[inside].astype(int)]
    here = value == _X_CORNER
    u, v = x[here] - (column[here] - 1.5) * BLOCK, y[here] - (row[here] - 1.5) * BLOCK
    value[here] = np.abs(v) <= np.abs(u)
    return value


_LAST, _X_CORNER = BLOCKS + 1, 2.0


def _layout() -> np.ndarray:
    """The blocks around the noise, and paper around these: white 1, black 0, or `_X_CORNER`; block (0, 0) is [1, 1]."""
    blocks = np.ones((_LAST + 1, _LAST + 1), np.float32)
    for value, places in ((0.0, BLACK_BLOCKS), (_X_CORNER, X_CORNER_BLOCKS)):
        for i, j in places:
            blocks[j + 1, i + 1] = value
    return blocks


_LAYOUT = _layout()


def exposed(picture: np.ndarray, rng: np.random.Generator, *, noise: float = 0.008, bits: int = 14) -> Plane:
    """A photograph of that light: white at 0.8, black at 0.02, noise (of the contrast, at white) as of photons."""
    white, black, read = 0.8, 0.02, 0.001
    levels = black + (white - black) * picture
    variance = read**2 + ((noise * (white - black)) ** 2 - read**2) * np.clip(levels, 0, None) / white
    most = 2**bits - 1
    samples = np.round(np.clip(levels + rng.standard_normal(picture.shape) * np.sqrt(variance), 0, 1) * most) / most
    return Plane("Y", samples.astype(np.float32), 1 / most)
