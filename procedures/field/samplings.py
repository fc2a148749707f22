"""Representations of a field in other programs: PSFs on a grid, or a polynomial of the position in every sample.

Images hold the whole PSF, the tail as far as its shapes extend (`Psf.extended`), normalised to all energy.
"""

from dataclasses import dataclass

import numpy as np

from procedures.field.maps import grid, mesh
from procedures.numerics.arrays import Array
from procedures.numerics.scattered import Polynomial
from procedures.psf import extended
from procedures.psf_field import PsfField, in_half_diagonals

FIT_COLUMNS = 16  # positions along the longer side at which a polynomial is fitted and compared with the field
MAX_DEGREE = 5  # (MAX_DEGREE + 1)(MAX_DEGREE + 2) / 2 = 21 images, more than the nodes of a field distinguish


@dataclass(frozen=True, eq=False)
class PsfPolynomial:
    """Every sample of the PSF as a polynomial of the position.

    images : (c, K, K), coefficients of x^a y^b, a + b <= degree, in the order of `powers`: 1, x, x^2, .., y, x y, .
    centre, scale : (x, y) and float; x is (column - centre) / scale, in pixels of the plane, likewise y
    lost : largest norm of the difference from the field over the PSF's norm, inside the nodes' hull
    """

    degree: int
    images: Array
    centre: tuple[float, float]
    scale: float
    lost: float


def whole_psfs(field: PsfField, points: Array) -> Array:
    """Whole PSFs (n, K, K) at points (n, 2) of the plane; their sums lack the energy beyond K."""
    parameters = field.parameters(points)
    energy = 1 / (1 - field.energy_outside(points))
    return np.stack([extended(p, field.k) for p in parameters]) / energy[:, None, None]


def grid_places(field: PsfField, columns: int) -> tuple[Array, Array]:
    """Whole pixels x (nx,) and y (ny,) of a grid over the frame, `columns` along its longer side."""
    x, y = grid(field.shape, columns)
    return np.round(x), np.round(y)


def as_polynomial(field: PsfField, *, allowed: float) -> PsfPolynomial:
    """The polynomial of the lowest degree that loses no more than `allowed` of the PSF's norm inside the nodes' hull,
    or the best one; it is extrapolated outside."""
    points = mesh(*grid(field.shape, FIT_COLUMNS))
    points = np.vstack([points[field.inside(points)], field.positions])
    psfs = whole_psfs(field, points)
    best = _fitted(field, points, psfs, 0)
    for degree in range(1, MAX_DEGREE + 1):
        if best.lost <= allowed:
            break
        try:
            best = min(best, _fitted(field, points, psfs, degree), key=lambda polynomial: polynomial.lost)
        except ValueError:
            break
    return best


def _fitted(field: PsfField, points: Array, psfs: Array, degree: int) -> PsfPolynomial:
    """Least-squares fit of one degree. Raises ValueError where the points do not determine it."""
    rows, columns = field.shape
    places = in_half_diagonals(points, field.shape)
    Polynomial(places, np.ones(len(places)), degree)  # raises ValueError
    design = powers(places, degree)
    flat = psfs.reshape(len(psfs), -1)
    images = np.linalg.lstsq(design, flat, rcond=None)[0]
    lost = np.linalg.norm(design @ images - flat, axis=1) / np.linalg.norm(flat, axis=1)
    centre = ((columns - 1) / 2, (rows - 1) / 2)
    shape = (-1, *psfs.shape[1:])
    return PsfPolynomial(degree, images.reshape(shape), centre, float(np.hypot(rows, columns) / 2), float(lost.max()))


def powers(places: Array, degree: int) -> Array:
    """x^a y^b with a + b <= degree at places (n, 2), y's power slowest, (n, (degree + 1)(degree + 2) / 2)."""
    x, y = places.T
    return np.stack([x**a * y**b for b in range(degree + 1) for a in range(degree + 1 - b)], axis=1)
