"""MTF of a square photosite along a direction: the sensor's contribution to a cross in the maps of a field.

Apart from the surfaces: the help of a command reads `ASSUMED`, and nothing heavy may be loaded for it.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.psf import Psf
from procedures.quality import frequencies, mtf_along

MIN_MTF = 0.1  # below this MTF of the photosite, division by it amplifies noise and the error of its side


@dataclass(frozen=True)
class Photosite:
    """A square photosite centred in its pixel. Raises BadParameter if the fill factor is impossible.

    fill : effective area over the pixel's, including the microlens
    uncertainty : standard uncertainty of `fill`
    assumed : whether it was not measured
    """

    fill: float
    uncertainty: float = 0.0
    assumed: bool = False

    def __post_init__(self) -> None:
        if not (0 < self.fill <= 1 and 0 <= self.uncertainty < self.fill):
            raise BadParameter(
                f"a fill factor must be greater than 0 and at most 1, its uncertainty smaller; got {self.fill:g} with "
                f"an uncertainty of {self.uncertainty:g}",
                "give area over area, as `fill_factor` of station psf pattern --physics",
            )

    def mtf(self, f: Array, angle: float, pitch: int) -> tuple[Array, Array]:
        """MTF, and its change when the fill factor grows by its standard uncertainty, both (n,).

        |sinc(a fx) sinc(a fy)|, a the root of the fill factor, sinc(x) = sin(pi x) / (pi x).

        f : (n,), cycles per pixel of a plane
        angle : direction in which the detail repeats, radians from x towards y
        pitch : sensor pixels per pixel of the plane
        """
        side = float(np.sqrt(self.fill))
        u, v = (f / pitch * turn for turn in (np.cos(angle), np.sin(angle)))
        along, across = np.sinc(side * u), np.sinc(side * v)
        # d sinc(a u) / da = (cos(pi a u) - sinc(a u)) / a
        slope = (np.cos(np.pi * side * u) - along) * across + (np.cos(np.pi * side * v) - across) * along
        both = along * across
        return np.abs(both), np.sign(both) * slope / (2 * self.fill) * self.uncertainty


ASSUMED = Photosite(0.9, 0.06, assumed=True)  # an unknown sensor with microlenses: uniformly distributed from 0.8 to 1


@dataclass(frozen=True)
class WithoutPhotosite:
    """MTF of a plane divided by that of the photosite; `pitch` is that of the plane, in sensor pixels."""

    photosite: Photosite
    pitch: int = 1

    def passed(self, f: npt.ArrayLike, angle: float) -> Array:
        """The photosite's MTF at frequencies of any shape along a direction."""
        return self.photosite.mtf(np.asarray(f, dtype=np.float64), angle, self.pitch)[0]

    def curve(self, psf: Psf, f: Array, angle: float) -> tuple[Array, Array]:
        """The quotient at frequencies (n,) along a direction, and its derivative (n, p + 1): by the PSF's parameters,
        and by the fill factor in its standard uncertainties."""
        value, slope = mtf_along(psf, f, angle)
        own, own_slope = self.photosite.mtf(f, angle, self.pitch)
        own = np.maximum(own, 1e-9)
        return value / own, np.column_stack([slope, -value * own_slope / own]) / own[:, None]

    def frequencies(self, psf: Psf, angle: float) -> Array:
        """Frequencies of a curve up to `MIN_MTF` of the photosite."""
        f = frequencies(psf)
        low = self.passed(f, angle) < MIN_MTF
        return f[: int(np.argmax(low))] if low.any() else f
