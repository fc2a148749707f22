"""Photographs of flat scenes shaken by a hand-held camera: real pictures, kernels of 13 to 27 pixels as measured."""

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d, shift
from scipy.signal import fftconvolve

Array = NDArray[np.float64]
RIM = 16


@dataclass(frozen=True)
class Conditions:
    """What befalls the photographs.

    noise : standard deviation, white = 1; bits : of the file; moved : shift of the second photograph that its kernel
    does not contain, x, y, pixels; measured : noise of the known kernels, of their greatest value; exposure : factor of
    light, highlights saturate; padded : kernels given in one common size; light : of the second photograph.
    """

    noise: float = 0.005
    bits: int = 8
    moved: tuple[float, float] = (0.0, 0.0)
    measured: float = 0.0
    exposure: float = 1.0
    padded: bool = False
    light: float = 1.0


@dataclass(frozen=True)
class Shaken:
    """Two photographs (H, W) of one flat scene, the kernels as known, the kernels as they were, and the sharp scene."""

    z: list[Array]
    known: list[Array]
    true: list[Array]
    sharp: Array

    @property
    def half_widths(self) -> list[float]:
        """Half-widths of the known kernels, pixels, between their outermost samples."""
        return [(len(k) - 1) / 2 for k in self.known]

    def psnr(self, u: Array, farthest: int = 3) -> float:
        """PSNR of a picture (H, W), dB, rim left out, after the common shift up to `farthest` that suits it best."""
        found = np.clip(u, 0, 1)
        steps = range(-farthest, farthest + 1)
        whole = min(product(steps, steps), key=lambda d: self._error(np.roll(found, d, (0, 1))))
        fine = [(whole[0] + a / 4, whole[1] + b / 4) for a, b in product(range(-3, 4), repeat=2)]
        return float(-10 * np.log10(min(self._error(shift(found, d, order=3, mode="nearest")) for d in fine)))

    def _error(self, u: Array) -> float:
        return float(np.mean((u - self.sharp)[RIM:-RIM, RIM:-RIM] ** 2))


def tremor(size: int, seed: int) -> Array:
    """Kernel (size, size), sum 1: a hand's tremor during one exposure, uneven in speed, a bright hook at its end."""
    rng = np.random.default_rng(seed)
    n = 4000
    drift = gaussian_filter1d(rng.standard_normal((2, 3 * n)).cumsum(axis=1), 150, axis=1)[:, n : 2 * n]
    turns = np.linspace(0, rng.uniform(15, 40), n)
    path = drift - drift[:, :1] + 0.06 * np.ptp(drift) * np.stack([np.sin(turns), np.sin(turns + 1.3)])
    hook = path[:, -1:] + 0.03 * np.ptp(drift) * gaussian_filter1d(rng.standard_normal((2, n // 5)), 40, axis=1) * 8
    path = np.concatenate([path, hook], axis=1)
    path -= (path.max(axis=1, keepdims=True) + path.min(axis=1, keepdims=True)) / 2
    path *= (size - 1.6) / 2 / np.abs(path).max()
    fine = 8
    places = np.round((path + size / 2) * fine - 0.5).astype(int)
    drawn = np.zeros((size * fine, size * fine))
    np.add.at(drawn, (places[1], places[0]), 1.0)
    kernel = gaussian_filter(drawn, 0.35 * fine).reshape(size, fine, size, fine).sum(axis=(1, 3))
    kernel[kernel < 0.02 * kernel.max()] = 0
    return np.asarray(kernel / kernel.sum())


@cache
def picture(name: str) -> Array:
    """A photograph bundled with scikit-image, grey, white = 1."""
    from skimage import data

    u = np.asarray(getattr(data, name)(), dtype=np.float64) / 255
    return u if u.ndim == 2 else np.asarray(u @ [0.299, 0.587, 0.114])


def shaken(
    name: str,
    sizes: tuple[int, int],
    seeds: tuple[int, int],
    conditions: Conditions,
    shape: tuple[int, int] = (255, 255),
) -> Shaken:
    """The middle of a picture photographed twice from a shaking hand."""
    c = conditions
    rng = np.random.default_rng(seeds)
    margin = max(sizes) // 2 + 4
    u = picture(name)
    top, left = ((n - m) // 2 - margin for n, m in zip(u.shape, shape, strict=True))
    u = c.exposure * u[top : top + shape[0] + 2 * margin, left : left + shape[1] + 2 * margin]
    true = [tremor(size, seed) for size, seed in zip(sizes, seeds, strict=True)]
    z = []
    for kernel, (dx, dy), light in zip(true, ((0.0, 0.0), c.moved), (1.0, c.light), strict=True):
        seen = shift(u, (dy, dx), order=3, mode="nearest")
        clean = fftconvolve(seen, kernel, mode="same")[margin:-margin, margin:-margin]
        white = 2**c.bits - 1
        z.append(np.round(np.clip(light * clean + c.noise * rng.standard_normal(shape), 0, 1) * white) / white)
    known = [np.clip(k + c.measured * k.max() * rng.standard_normal(k.shape), 0, None) for k in true]
    if c.padded:
        known = [np.pad(k, (max(sizes) - len(k)) // 2) for k in known]
    return Shaken(z, [k / k.sum() for k in known], true, np.clip(u[margin:-margin, margin:-margin], 0, 1))
