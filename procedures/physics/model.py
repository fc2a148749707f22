"""Model PSF of given parts and parameters on a measured PSF's grid, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procedures.numerics.arrays import Array, Complex
from procedures.physics.pupil import TERMS, Pupil
from procedures.physics.sensor import BOUNDS, START, ModelParts, sensor_otf
from procedures.psf import Psf
from procedures.quality import Diffraction

PERIOD_PX = 16
"""Period of the model in pixels of the plane: the diffraction tail there is 1 / 400 of that at the PSF's rim."""
SMALL = 1e-4
LARGEST_WAVES = 1.0
LARGEST_SHIFT_PX = 1.5


@dataclass(frozen=True, eq=False)
class Grid:
    """Sampling of the PSF, and the known properties of the camera. pitch : sensor pixels per pixel of the plane."""

    psf: Psf
    diffraction: Diffraction
    pitch: int

    @cached_property
    def pupil(self) -> Pupil:
        """The lens pupil, up to the PSF's highest frequency."""
        return Pupil(self.diffraction.cutoff, 1 / PERIOD_PX, self.psf.s / 2)

    @cached_property
    def f(self) -> Array:
        """Frequencies along an axis, (n,), cycles per pixel of the plane."""
        count = PERIOD_PX * self.psf.s // 2
        return np.arange(-count, count + 1) / PERIOD_PX

    @cached_property
    def _waves(self) -> Complex:
        """exp(2 pi i f x) of every sample along an axis, (k, n); the two band limits have weight one half."""
        weight = np.ones(len(self.f))
        weight[[0, -1]] = 0.5
        return np.asarray(np.exp(2j * np.pi * self.psf.offsets_px[:, None] * self.f) * weight)

    def samples(self, otf: Complex) -> Array:
        """Samples (..., k^2) of transfer functions (..., n, n), up to a common factor."""
        values = np.real(self._waves @ otf @ self._waves.T)
        return np.asarray(values.reshape(*otf.shape[:-2], -1))

    def model(self, parts: ModelParts, p: Array) -> tuple[Array, Array]:
        """Samples (k^2,) of sum 1, and their derivatives (k^2, parameters), at `p` in the order of `names_of`."""
        count = len(parts.names)
        fx, fy = self.f[None, :], self.f[:, None]
        shift = np.exp(-2j * np.pi * (fx * p[0] + fy * p[1]))
        values, waves = p[2 : 2 + count], np.zeros(len(TERMS))
        waves[list(parts.aberrations)] = p[2 + count :]
        lens, lens_slopes = self.pupil.otf_and_slopes(waves, parts.aberrations)
        sensor = sensor_otf(parts, values, fx / self.pitch, fy / self.pitch)
        otf = shift * sensor * lens
        slopes = [-2j * np.pi * fx * otf, -2j * np.pi * fy * otf]
        for i in range(count):
            step = SMALL * np.eye(count)[i]
            above, below = (sensor_otf(parts, values + e, fx / self.pitch, fy / self.pitch) for e in (step, -step))
            slopes.append(shift * lens * (above - below) / (2 * SMALL))
        slopes += [shift * sensor * one for one in lens_slopes]
        h, J = self.samples(otf), self.samples(np.stack(slopes)).T
        total = h.sum()
        h = h / total
        return h, (J - h[:, None] * J.sum(axis=0)) / total


def names_of(parts: ModelParts) -> tuple[str, ...]:
    """Names of all parameters: shift in pixels of the plane, sensor parameters, aberrations in waves."""
    return ("shift_x", "shift_y", *parts.names, *(TERMS[i] for i in parts.aberrations))


def start_of(parts: ModelParts, even_waves: float, spherical_waves: float) -> Array:
    """Starting values of a fit; even aberrations start off zero, where their derivative vanishes."""
    start = {"defocus": even_waves, "astigmatism": even_waves / 3, "astigmatism_oblique": even_waves / 3}
    start |= {"spherical": spherical_waves, **START}
    return np.array([start.get(name, 0.0) for name in names_of(parts)])


def bounds_of(parts: ModelParts) -> tuple[Array, Array]:
    """Smallest and largest values of all parameters."""
    wide = {
        **BOUNDS,
        "shift_x": (-LARGEST_SHIFT_PX, LARGEST_SHIFT_PX),
        "shift_y": (-LARGEST_SHIFT_PX, LARGEST_SHIFT_PX),
    }
    limits = np.array([wide.get(name, (-LARGEST_WAVES, LARGEST_WAVES)) for name in names_of(parts)])
    return limits[:, 0], limits[:, 1]
