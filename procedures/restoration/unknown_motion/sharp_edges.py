"""A picture of few edges common to several photographs, and the kernels that blur it into them.

Where most differences of neighbours are zero, the remaining edges are sharper than any blur: kernels that explain the
photographs from them are those of the motion, not a part of it. The photographs are continued periodically.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fftfreq, irfft2, next_fast_len, rfft2, rfftfreq

from procedures.restoration.unknown_motion.free_kernels import Kernels, least_squares

Pictures = NDArray[np.float32]
Spectra = NDArray[np.complex64]
STIFFEST = 1e5
"""Largest coupling between a picture's differences and the sparse ones, which are then equal."""


class EdgePicture:
    """Photographs (P, H, W) of one flat scene, for kernels of half-size R."""

    def __init__(self, z: Pictures, R: int) -> None:
        self.R, self.frame = R, z.shape[1:]
        self.z = periodic(z, R)
        self.size: tuple[int, ...] = self.z.shape[1:]
        self.spectra = rfft2(self.z)
        down = np.exp(2j * np.pi * fftfreq(self.size[0]))[:, None] - 1
        across = np.exp(2j * np.pi * rfftfreq(self.size[1]))[None] - 1
        self.differences = [down.astype(np.complex64), across.astype(np.complex64)]
        self.steepness = (np.abs(down) ** 2 + np.abs(across) ** 2).astype(np.float32)

    def picture(self, kernels: Kernels, weight: float) -> Pictures:
        """The picture of least sum |h * u - z|^2 + weight x number of pixels that differ from a neighbour, by
        half-quadratic splitting (Xu, Lu, Xu, Jia, ACM Trans. Graphics 2011)."""
        H = self._spectra_of(kernels)
        blurred, power = (H.conj() * self.spectra).sum(axis=0), (np.abs(H) ** 2).sum(axis=0)
        u, coupling = self.z.mean(axis=0), 2 * weight
        while coupling < STIFFEST:
            steps = [np.roll(u, -1, axis) - u for axis in (0, 1)]
            large = steps[0] ** 2 + steps[1] ** 2 >= weight / coupling
            edges = sum(d.conj() * rfft2(step * large) for d, step in zip(self.differences, steps, strict=True))
            u = irfft2((blurred + coupling * edges) / (power + coupling * self.steepness), self.size)
            coupling *= 2
        return np.asarray(u, np.float32)

    def kernels(self, u: Pictures, kernels: Kernels, ridge: float, iterations: int) -> Kernels:
        """The kernels that blur the picture's differences into the photographs', from initial ones."""
        R, U = self.R, rfft2(u)
        H = self._spectra_of(kernels)
        gradient, correlation = np.zeros(1, np.float32), np.zeros(1, np.float32)
        for d in self.differences:
            residual = irfft2(d * (self.spectra - U * H), self.size) * self._inside
            gradient = gradient + irfft2((d * U).conj() * rfft2(residual), self.size)
            correlation = correlation + irfft2(np.abs(rfft2(irfft2(d * U, self.size) * self._inside)) ** 2, self.size)
        near, far = np.arange(-R, R + 1), np.arange(-2 * R, 2 * R + 1)
        near_gradient = gradient[:, near[:, None], near]
        return least_squares(kernels, near_gradient, correlation[np.ix_(far, far)], ridge, iterations)

    @property
    def _inside(self) -> Pictures:
        """1 where a photograph's differences are measured and its surroundings have little effect."""
        rim, (height, width) = self.R // 2, self.frame
        inside = np.zeros(self.size, np.float32)
        inside[rim : height - 1 - rim, rim : width - 1 - rim] = 1
        return inside

    def _spectra_of(self, kernels: Kernels) -> Spectra:
        K = kernels.shape[1]
        wide = np.zeros((len(kernels), *self.size), np.float32)
        wide[:, :K, :K] = kernels
        spectra: Spectra = rfft2(np.roll(wide, (-(K // 2), -(K // 2)), (1, 2)))
        return spectra


def periodic(z: Pictures, R: int) -> Pictures:
    """The photographs extended by at least 2 R rows and columns, which make them periodic."""
    for axis in (1, 2):
        n = z.shape[axis]
        more = next_fast_len(n + 2 * R, True) - n
        share = np.expand_dims(np.linspace(0, 1, more + 2, dtype=np.float32)[1:-1], (0, 3 - axis))
        first, last = np.take(z, [0], axis), np.take(z, [-1], axis)
        z = np.concatenate([z, (1 - share) * last + share * first], axis)
    return z
