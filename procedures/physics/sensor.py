"""Transfer functions of the sensor: photosite aperture, optical low-pass filter, charge diffusion.

Lengths are in sensor pixels, frequencies in cycles per sensor pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from procedures.numerics.arrays import Array, Complex


class Aperture(StrEnum):
    """Shape of the photosite: a square, or an L without the corner in a direction, from x towards y, y down."""

    SQUARE = "square"
    L_45 = "L without the corner at 45 degrees"
    L_135 = "L without the corner at 135 degrees"
    L_225 = "L without the corner at 225 degrees"
    L_315 = "L without the corner at 315 degrees"

    @property
    def missing_corner_deg(self) -> int | None:
        """Direction of the missing corner; None for a square."""
        return {"L_45": 45, "L_135": 135, "L_225": 225, "L_315": 315}.get(self.name)


class LowPass(StrEnum):
    """Birefringent low-pass filter: number and direction of the spots."""

    NONE = "none"
    TWO_ALONG_X = "two spots along x"
    TWO_ALONG_Y = "two spots along y"
    FOUR = "four spots"


@dataclass(frozen=True)
class ModelParts:
    """The parts of a model, besides diffraction and a shift.

    diffusion : whether charge diffuses, as a Gaussian; aberrations : indices of `pupil.TERMS` that are free.
    """

    aperture: Aperture = Aperture.SQUARE
    low_pass: LowPass = LowPass.NONE
    diffusion: bool = False
    aberrations: tuple[int, ...] = tuple(range(8))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensor parameters, in the order of `sensor_otf`'s."""
        names = ["side"]
        names += ["notch"] if self.aperture is not Aperture.SQUARE else []
        names += ["separation"] if self.low_pass is not LowPass.NONE else []
        return tuple(names + (["diffusion"] if self.diffusion else []))


START = {"side": 0.9, "notch": 0.5, "separation": 0.7, "diffusion": 0.25}
BOUNDS = {"side": (0.3, 1.15), "notch": (0.05, 0.9), "separation": (0.05, 1.6), "diffusion": (0.0, 1.5)}
"""Bounds of the parameters: side of the square aperture, side of the missing corner relative to it, distance of the
spots, standard deviation of the charge diffusion."""


def sensor_otf(parts: ModelParts, values: Array, fx: Array, fy: Array) -> Complex:
    """Product of the sensor's transfer functions at frequencies that broadcast, for values in the order of `names`."""
    given = dict(zip(parts.names, values, strict=True))
    otf = aperture_otf(parts.aperture, given["side"], given.get("notch", 0.0), fx, fy)
    d = given.get("separation", 0.0)
    if parts.low_pass in (LowPass.TWO_ALONG_X, LowPass.FOUR):
        otf = otf * np.cos(np.pi * d * fx)
    if parts.low_pass in (LowPass.TWO_ALONG_Y, LowPass.FOUR):
        otf = otf * np.cos(np.pi * d * fy)
    charge = np.exp(-2 * np.pi**2 * given.get("diffusion", 0.0) ** 2 * (fx * fx + fy * fy))
    return np.asarray(otf * charge, dtype=np.complex128)


def aperture_otf(aperture: Aperture, side: float, notch: float, fx: Array, fy: Array) -> Complex:
    """Transfer function of a square about the pixel's centre without a corner of `notch` times its side.

    Yadid-Pecht, IEEE Trans. Electron Devices 47, 2000, gives the moduli of these shapes.
    """
    whole = side**2 * np.sinc(fx * side) * np.sinc(fy * side) + 0j
    direction = aperture.missing_corner_deg
    if direction is None:
        return np.asarray(whole / side**2)
    n = notch * side
    x, y = (float(np.sign(f(np.radians(direction)))) * (side - n) / 2 for f in (np.cos, np.sin))
    corner = n**2 * np.sinc(fx * n) * np.sinc(fy * n) * np.exp(-2j * np.pi * (fx * x + fy * y))
    return np.asarray((whole - corner) / (side**2 - n**2))
