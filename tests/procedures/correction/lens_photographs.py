"""Photographs through a lens outside the method's model: every point's light is spread by transfer functions of the
pupil, on a grid over the frame, and sampled by the sensor; shares no code with the correction."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import oaconvolve

Array = np.ndarray
RGGB = {"R": (0, 0), "G1": (1, 0), "G2": (0, 1), "B": (1, 1)}
"""(x, y) of each plane's first pixel."""


def sampled(whole: Array, s: int, per_px: int) -> Array:
    """A PSF of s samples per pixel (n, n), n even, centre n // 2, resampled to `per_px` samples per pixel; odd size."""
    n, m = len(whole), len(whole) * per_px // s
    F = np.fft.fftshift(np.fft.fft2(np.fft.ifftshift(whole)))
    low = n // 2 - m // 2
    small = np.fft.fftshift(np.fft.ifft2(np.fft.ifftshift(F[low : low + m, low : low + m])).real)
    return small[1:, 1:]  # odd: the centre sample in the middle


def blurred(scene: Array, kernels: Sequence[Sequence[Array]], rim: int) -> Array:
    """The scene with each point's light spread by interpolated kernels (a grid over the frame without its rim)."""
    rows, columns = (np.clip(np.arange(n) - rim, 0, n - 2 * rim - 1) / (n - 2 * rim - 1) for n in scene.shape)
    down, across = _hats(rows, len(kernels)), _hats(columns, len(kernels[0]))
    out = np.zeros_like(scene)
    for i, j in np.ndindex(len(kernels), len(kernels[0])):
        y, x = np.flatnonzero(down[i]), np.flatnonzero(across[j])
        part = scene[y[0] : y[-1] + 1, x[0] : x[-1] + 1] * np.outer(down[i, y], across[j, x])
        wide, half = oaconvolve(part, kernels[i][j], mode="full"), len(kernels[i][j]) // 2
        top, left = y[0] - half, x[0] - half
        a, b = max(0, -top), max(0, -left)
        c, d = min(len(wide), len(scene) - top), min(wide.shape[1], scene.shape[1] - left)
        out[top + a : top + c, left + b : left + d] += wide[a:c, b:d]
    return out[rim:-rim, rim:-rim]


def _hats(at: Array, n: int) -> Array:
    return np.clip(1 - np.abs(at * (n - 1) - np.arange(n)[:, None]), 0, 1)


@dataclass(frozen=True)
class Sensor:
    """Read-out with photon noise, read noise and 14-bit quantisation; white = 1."""

    white_e: float = 20000.0
    read_e: float = 6.0
    steps: int = 16383

    def read(self, light: Array, rng: np.random.Generator) -> Array:
        electrons = np.maximum(light, 0) * self.white_e
        values = (electrons + np.sqrt(electrons + self.read_e**2) * rng.standard_normal(light.shape)) / self.white_e
        return np.minimum(np.rint(values * self.steps) / self.steps, 1.0).astype(np.float32)


def kernels_over(
    psf: Callable[[float, float], Array], shape: tuple[int, int], grid: tuple[int, int]
) -> list[list[Array]]:
    """PSFs on a grid of positions of a frame, corners included."""
    y, x = np.linspace(0, shape[0] - 1, grid[0]), np.linspace(0, shape[1] - 1, grid[1])
    return [[psf(float(b), float(a)) for b in x] for a in y]
