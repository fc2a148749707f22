"""The power spectrum of temporal noise (NPS), from the difference of two pictures of even light.

Blocks of the difference are transformed under a window; the mean of their squared moduli, divided by the window's
power, has the variance as its mean over the band. IEC 62220-1, in two dimensions and in pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.sensor.levels import Numbers

BLOCK = 32  # side of a block in pixels: number of frequencies along each axis
LEAST_SIDE = 5  # minimum side of a spectrum: two different frequencies on each side of 0
NEIGHBOURS = (35 / 18) ** 2
"""Increase of the variance of sums over frequencies by their correlation, under Hann windows along both axes."""


@dataclass(frozen=True, eq=False)
class NoisePower:
    """The NPS at one signal.

    power : (n, n), [fy, fx] in the order of `numpy.fft.fftfreq`; DN^2 per (cycle/pixel)^2: its mean is the variance
    signal : mean less dark of the pictures, DN
    blocks : averaged blocks: each value has the relative standard uncertainty 1 / sqrt(blocks)
    """

    power: Array
    signal: float
    blocks: int

    @property
    def frequencies(self) -> Array:
        """Along one axis, cycles per pixel, in the order of `power`."""
        return np.asarray(np.fft.fftfreq(len(self.power)), dtype=np.float64)


def measure_noise_power(pictures: Sequence[Numbers], signal: float, block: int = BLOCK) -> NoisePower | None:
    """NPS of pairs of pictures (rows, columns); None where no block fits into them. signal : mean less dark."""
    window = np.hanning(block + 1)[:-1]
    taper = window[:, None] * window[None, :]
    total, count = np.zeros((block, block)), 0
    for a, b in zip(pictures[::2], pictures[1::2], strict=False):
        difference = (np.asarray(b, dtype=np.float64) - a) / np.sqrt(2)
        blocks = _blocks(difference - difference.mean(), block)
        total += np.sum(np.abs(np.fft.fft2(blocks * taper)) ** 2, axis=0)
        count += len(blocks)
    return NoisePower(total / count / np.sum(taper**2), signal, count) if count else None


def _blocks(picture: Array, side: int) -> Array:
    down, across = (length // side for length in picture.shape)
    cut = picture[: down * side, : across * side]
    return cut.reshape(down, side, across, side).swapaxes(1, 2).reshape(-1, side, side)
