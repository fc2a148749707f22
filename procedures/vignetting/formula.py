"""The light of a plane over its frame: as a record keeps it, and as the even powers of a radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.scattered import monomials
from procedures.psf_field import in_half_diagonals

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LightSurface:
    """Log light as a polynomial of the place.

    Attributes
    ----------
    shape : (rows, columns) of the plane
    degree : int
    coefficients : (c,) float64
        Beside the monomials of the place in half diagonals from the frame's centre, without the constant.
    """

    shape: tuple[int, int]
    degree: int
    coefficients: Array

    def __post_init__(self) -> None:
        if self.coefficients.shape != (terms_of(self.degree),) or not np.isfinite(self.coefficients).all():
            raise ValueError(f"a surface of degree {self.degree} has {terms_of(self.degree)} finite coefficients")

    def at(self, points: Array) -> Array:
        """Light at points (n, 2) of the plane over that at the frame's centre."""
        return np.asarray(np.exp(design_of(in_half_diagonals(points, self.shape), self.degree) @ self.coefficients))


@dataclass(frozen=True, eq=False)
class EvenPowers:
    """A (1 + sum over i of terms[i] r^(2 i + 2)), and the share of the value by which it errs: rms and largest."""

    terms: Array
    lost: float
    most: float


def terms_of(degree: int) -> int:
    """Coefficients of a surface."""
    return (degree + 1) * (degree + 2) // 2 - 1


def design_of(u: Array, degree: int) -> Array:
    """The monomials without the constant at u (n, 2), (n, c)."""
    return monomials(u, degree)[:, 1:]


def even_powers(r: Array, values: Array, count: int) -> EvenPowers:
    """The even powers of r (n,) next to values (n,), by their relative error; A is left free."""
    design = r[:, None] ** (2 * np.arange(count + 1))
    found = np.linalg.lstsq(design / values[:, None], np.ones(len(values)), rcond=None)[0]
    left = design @ found / values - 1
    return EvenPowers(found[1:] / found[0], float(np.sqrt(np.mean(left**2))), float(np.abs(left).max()))
