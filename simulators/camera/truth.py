"""Ground truth of a simulated calibration: the sampled continuous point spread function."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from simulators.camera.optics import WAVELENGTHS_UM, ColourShift, Optics
from simulators.world.projection import Projection, apply_homography

Array = npt.NDArray[np.float64]

PERIOD_PX = 160
"""Pixels of the plane after which the sampled PSF repeats; the tail of Airy's disc beyond weighs less than 1e-7."""


@dataclass(frozen=True, eq=False)
class TruePsf:
    """The PSF of one plane, low-passed to s / 2 cycles per pixel: the part resolved by an estimate on the 1/s grid.

    Attributes
    ----------
    samples : (k, k)
        Samples [row, column], pitch 1/s pixel of the plane, centre sample at the geometric centre, scaled so that
        the sum over the whole plane is 1.
    s : int
        Samples per pixel.
    energy_outside : float
        1 minus the sum of the samples inside the support.
    floor : float
        Relative norm of the part outside the support: a lower bound of the error of k x k samples.
    """

    samples: Array
    s: int
    energy_outside: float
    floor: float

    @property
    def h(self) -> Array:
        """Samples normalised to sum 1 as those of an estimate, (k, k)."""
        return np.asarray(self.samples / self.samples.sum(), dtype=np.float64)


def true_psf(optics: Optics, s: int, k: int, *, colour: str = "Y", pitch: int = 1) -> TruePsf:
    """The PSF of a plane, s samples per pixel, k x k of them.

    Parameters
    ----------
    pitch : int
        Sensor pixels per pixel of the plane: 2 for a Bayer plane.
    """
    n = s * PERIOD_PX
    f = np.fft.fftfreq(n) * s / pitch  # cycles per sensor pixel
    otf = np.asarray(optics.otf(f[None, :], f[:, None], colour), dtype=np.complex128)
    whole = np.fft.fftshift(np.fft.ifft2(otf).real)
    low = n // 2 - k // 2
    inside = whole[low : low + k, low : low + k]
    energy, power = float(inside.sum()), float(np.sum(inside**2))
    floor = max(1 - power / float(np.sum(whole**2)), 0.0) ** 0.5
    return TruePsf(inside, s, 1 - energy, floor)


def true_mtf(optics: Optics, frequency: Array, angle_deg: float, *, colour: str = "Y", pitch: int = 1) -> Array:
    """Modulus of the transfer function along a direction, at frequencies in cycles per pixel of the plane."""
    f = np.asarray(frequency, dtype=np.float64) / pitch
    turn = np.radians(angle_deg)
    return np.asarray(np.abs(optics.otf(f * np.cos(turn), f * np.sin(turn), colour)), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class ChartTruth:
    """Position and optics of a chart in an image.

    Attributes
    ----------
    H_sensor_pattern : (3, 3)
        Pattern coordinates (cells) to sensor pixels, before distortion.
    projection : Projection
        Holds the distortion.
    optics : Optics
        Blur, centred on the chart's points in the given colour.
    colour_shift : ColourShift
        Shift of colours other than green.
    """

    H_sensor_pattern: Array
    projection: Projection
    optics: Optics
    colour_shift: ColourShift = field(default_factory=ColourShift)

    def sensor_points(self, cells: Array, colour: str = "G") -> Array:
        """Pattern points (n, 2) to sensor pixels (x, y) in a colour, distortion included, (n, 2)."""
        points = apply_homography(self.H_sensor_pattern, np.asarray(cells, dtype=np.float64))
        return np.asarray(self.projection.distort(points) + self.colour_shift.at(WAVELENGTHS_UM[colour]))

    def psf(self, s: int, k: int, *, colour: str = "Y", pitch: int = 1) -> TruePsf:
        """The true PSF at this chart in one colour."""
        return true_psf(self.optics, s, k, colour=colour, pitch=pitch)
