"""The field as other programs hold one: PSFs on a grid, or a polynomial of the place in every sample.

PSFs are images of the whole PSF, the tail as far as its shapes reach (`Psf.extended`), all light being 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.field.maps import grid
from procedures.numerics.scattered import Polynomial
from procedures.psf import extended
from procedures.psf_field import PsfField, in_half_diagonals

Array = npt.NDArray[np.float64]

DENSE = 16
"""Places along the longer side at which a polynomial is fitted and held against the field."""
HIGHEST = 5
"""Degree: (HIGHEST + 1)(HIGHEST + 2) / 2 = 21 images, more than a field has nodes to tell apart."""


@dataclass(frozen=True, eq=False)
class PsfPolynomial:
    """Every sample of the PSF as a polynomial of the place.

    Attributes
    ----------
    degree : int
    images : (c, K, K) float64
        Beside x^a y^b, a + b <= degree, y's power slowest: 1, x, x^2, .., y, x y, ..; x and y as `centre` and `scale`
        make them.
    centre, scale : (x, y) and float
        x is (column - centre) / scale, in pixels of the plane, likewise y.
    lost : float
        Largest norm of the difference from the field over the PSF's norm, where the nodes enclose the place.
    """

    degree: int
    images: Array
    centre: tuple[float, float]
    scale: float
    lost: float


def whole_psfs(field: PsfField, points: Array) -> Array:
    """Whole PSFs at points (n, 2) of the plane, (n, K, K), all light 1: their sums lack what lies beyond K."""
    parameters = field.parameters(points)
    light = 1 / (1 - field.energy_outside(points))
    return np.stack([extended(p, field.k) for p in parameters]) / light[:, None, None]


def grid_places(field: PsfField, columns: int) -> tuple[Array, Array]:
    """Whole pixels x (nx,) and y (ny,) of a grid over the frame, `columns` along its longer side, rims included."""
    x, y = grid(field.shape, columns)
    return np.round(x), np.round(y)


def as_polynomial(field: PsfField, *, allowed: float) -> PsfPolynomial:
    """The field as a polynomial of the lowest degree that loses no more than `allowed` of the PSF's norm, or the best.

    Beyond the nodes the field does not vary, which no polynomial follows: there it goes on as it is inside.
    """
    x, y = grid(field.shape, DENSE)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = np.vstack([points[field.inside(points)], field.positions])
    psfs = whole_psfs(field, points)
    best: PsfPolynomial | None = None
    for degree in range(HIGHEST + 1):
        try:
            found = _fitted(field, points, psfs, degree)
        except ValueError:
            break
        if best is None or found.lost < best.lost:
            best = found
        if best.lost <= allowed:
            break
    assert best is not None  # a constant is always determined
    return best


def _fitted(field: PsfField, points: Array, psfs: Array, degree: int) -> PsfPolynomial:
    rows, columns = field.shape
    places = in_half_diagonals(points, field.shape)
    Polynomial(places, np.ones(len(places)), degree)  # whether the places determine it
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
