"""The light of a plane over its frame: as a polynomial, and as even powers of a radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.scattered import monomials
from procedures.psf_field import in_half_diagonals


@dataclass(frozen=True, eq=False)
class LightSurface:
    """Log light as a polynomial of the position.

    shape : (rows, columns) of the plane; coefficients : (c,) coefficients of the monomials of the position in half
    diagonals from the frame's centre, without the constant.
    """

    shape: tuple[int, int]
    degree: int
    coefficients: Array

    def __post_init__(self) -> None:
        if self.coefficients.shape != (terms_of(self.degree),) or not np.isfinite(self.coefficients).all():
            raise ValueError(f"a surface of degree {self.degree} needs {terms_of(self.degree)} finite coefficients")

    def at(self, points: Array) -> Array:
        """Light at points (n, 2) of the plane, relative to the frame's centre."""
        return np.asarray(np.exp(design_of(in_half_diagonals(points, self.shape), self.degree) @ self.coefficients))


@dataclass(frozen=True, eq=False)
class EvenPowers:
    """A (1 + sum over i of terms[i] r^(2 i + 2)), and its relative error: rms and largest."""

    terms: Array
    lost: float
    most: float


def terms_of(degree: int) -> int:
    """Number of coefficients of a surface."""
    return (degree + 1) * (degree + 2) // 2 - 1


def design_of(u: Array, degree: int) -> Array:
    """The monomials without the constant at u (n, 2), (n, c)."""
    return monomials(u, degree)[:, 1:]


def even_powers(r: Array, values: Array, count: int) -> EvenPowers:
    """Least-squares fit of even powers of r (n,) to values (n,), by relative error, with free A."""
    design = r[:, None] ** (2 * np.arange(count + 1))
    c = np.linalg.lstsq(design / values[:, None], np.ones(len(values)), rcond=None)[0]
    error = design @ c / values - 1
    return EvenPowers(c[1:] / c[0], float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()))
