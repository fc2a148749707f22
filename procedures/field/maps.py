"""Maps over the frame derived from a PSF field: numbers of the whole PSF with their standard uncertainties.

Sagittal and meridional refer to the frame's centre: meridional detail repeats along the radius, sagittal detail across
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.field.photosite import WithoutPhotosite
from procedures.field.surfaces import Surface
from procedures.numbers import (
    ENERGY_ABOVE_NYQUIST,
    ENERGY_OUTSIDE_SUPPORT,
    ERROR_INTERPOLATION,
    ERROR_NOISE,
    OF_PLACES,
    without_photosite,
)
from procedures.numerics.arrays import Array
from procedures.numerics.scattered import Hull
from procedures.psf import Psf
from procedures.psf_field import PsfField, in_half_diagonals
from procedures.quality import crossing_model_error, frequencies, mtf_along
from procedures.spatial_numbers import energy_above_nyquist
from procedures.stray_tail import tail_energy_uncertainty
from procedures.transfer_function import first_crossing

COLUMNS = 21  # positions of a map along the frame's longer side
MAPS = (*OF_PLACES, ENERGY_ABOVE_NYQUIST, ENERGY_OUTSIDE_SUPPORT)  # maps of numbers derived from the PSF
BEFORE_PHOTOSITES = tuple(without_photosite(name) for name in OF_PLACES)
"""Optional maps without the photosites: lens, filters, and charge diffusion."""
ERRORS = (ERROR_NOISE, ERROR_INTERPOLATION)  # maps of the field's predicted error: its norm over that of the PSF


@dataclass(frozen=True, eq=False)
class FieldMap:
    """A number over the frame.

    x : (nx,), y : (ny,); positions in pixels of the plane
    value : (ny, nx), NaN where the number is undefined
    uncertainty : (ny, nx) or None; None where the value is itself an uncertainty
    enclosed : (ny, nx) bool or None; mask of the positions inside the hull of the nodes, where the others have a value
        too; None: the finite values
    """

    name: str
    title: str
    unit: str
    x: Array
    y: Array
    value: Array
    uncertainty: Array | None
    enclosed: npt.NDArray[np.bool_] | None = None

    @property
    def share(self) -> float:
        """Share of the frame inside the hull of the nodes."""
        return float((np.isfinite(self.value) if self.enclosed is None else self.enclosed).mean())

    def median(self, values: Array) -> float:
        """Median of values (ny, nx) at the map's positions inside the hull; NaN where there are none."""
        inside = values if self.enclosed is None else values[self.enclosed]
        return float(np.nanmedian(inside)) if np.isfinite(inside).any() else np.nan


def grid(shape: tuple[int, int], columns: int = COLUMNS) -> tuple[Array, Array]:
    """x (nx,) and y (ny,) of equally spaced positions over a plane of that shape, half a step from its sides."""
    step = max(shape) / columns
    rows, columns = (max(round(size / step), 1) for size in shape)
    x, y = ((np.arange(n) + 0.5) * size / n - 0.5 for n, size in ((columns, shape[1]), (rows, shape[0])))
    return x, y


def mesh(x: Array, y: Array) -> Array:
    """Points (ny nx, 2) of a grid, row by row."""
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def radius_direction(shape: tuple[int, int], x: float, y: float) -> float:
    """Direction from the frame's centre to a position of the plane, radians from x towards y."""
    return float(np.arctan2(y - (shape[0] - 1) / 2, x - (shape[1] - 1) / 2))


def surface_maps(
    surface: Surface,
    positions: Array,
    shape: tuple[int, int],
    columns: int,
    unit: str,
    combinations: Sequence[tuple[str, str, Array]],
) -> tuple[FieldMap, ...]:
    """Maps of linear combinations of a surface's components, inside the hull of its positions (N, 2) in the plane.

    `combinations` are names, titles, and weights of the components: (m,), or (n, m) by point of the map.
    """
    x, y = grid(shape, columns)
    points = mesh(x, y)
    inside = Hull(positions).holds(points)
    places = in_half_diagonals(points, shape)
    value, covariance = surface.at(places), surface.covariance(places)
    maps = []
    for name, title, weights in combinations:
        u = np.broadcast_to(weights, value.shape)
        spread = np.sqrt(np.einsum("na,nab,nb->n", u, covariance, u))
        images = (np.where(inside, v, np.nan).reshape(len(y), len(x)) for v in (np.sum(u * value, axis=1), spread))
        maps.append(FieldMap(name, title, unit, x, y, *images))
    return tuple(maps)


def derive(field: PsfField, columns: int = COLUMNS, without: WithoutPhotosite | None = None) -> tuple[FieldMap, ...]:
    """All maps of one plane: `MAPS`, those before the photosites where `without` is given, and `ERRORS`.

    Outside the nodes' hull the PSF is that of `PsfField.at`.
    """
    x, y = grid(field.shape, columns)
    names = (*MAPS, *BEFORE_PHOTOSITES) if without else MAPS
    value, uncertainty = np.full((2, len(names), len(y), len(x)), np.nan)
    errors = np.full((len(ERRORS), len(y), len(x)), np.nan)
    points = mesh(x, y)
    enclosed = field.inside(points).reshape(len(y), len(x))
    parameters = field.parameters(points).reshape(len(y), len(x), -1)
    for row, column in np.ndindex(enclosed.shape):
        at = float(x[column]), float(y[row])
        parts = field.covariances(*at)
        psf = Psf.of(parameters[row, column], parts[0] + parts[1], field.k, field.s, parts[1])
        norm = float(np.linalg.norm(psf.extended()))
        errors[:, row, column] = [field.norm_of_error(C) / norm for C in parts]
        radius = radius_direction(field.shape, *at)
        numbers = [numbers_of(psf, radius)] + ([mtf50_about(psf, radius, without)] if without else [])
        value[:, row, column], uncertainty[:, row, column] = np.hstack(numbers)
    images = zip((*names, *ERRORS), (*value, *errors), (*uncertainty, None, None), strict=True)
    return tuple(FieldMap(name, name.label, name.unit, x, y, v, u, enclosed) for name, v, u in images)


def numbers_of(psf: Psf, radius: float) -> tuple[Array, Array]:
    """The numbers of MAPS at one position, and their standard uncertainties; NaN where undefined.

    The uncertainties include the truncation of the tail's shapes, which is common to all nodes. `radius` is the
    direction from the frame's centre, in radians.
    """
    values, uncertainties = mtf50_about(psf, radius)
    above, slope = energy_above_nyquist(psf)
    of_above = np.sqrt(max(float(slope @ psf.parameter_covariance @ slope), 0.0))
    outside, noise = psf.energy_outside if len(psf.tail.amplitudes) else (np.nan, np.nan)
    of_outside = np.hypot(noise, tail_energy_uncertainty(psf))
    return np.append(values, [above, outside]), np.append(uncertainties, [of_above, of_outside])


def mtf50_about(psf: Psf, radius: float, without: WithoutPhotosite | None = None) -> tuple[Array, Array]:
    """Sagittal MTF50, meridional MTF50 and their difference (3,), and standard uncertainties (3,).

    Of the camera, or `without` the photosites; NaN where the MTF stays above 1/2.
    """
    two = [_mtf50(psf, angle, without) for angle in (radius + np.pi / 2, radius)]
    (sagittal, by_sagittal, stray_s), (meridional, by_meridional, stray_m) = two
    slopes = np.array([by_sagittal, by_meridional, by_sagittal - by_meridional])
    truncated = np.array([stray_s, stray_m, np.hypot(stray_s, stray_m)])
    values = np.array([sagittal, meridional, sagittal - meridional])
    return values, np.hypot(propagated(psf, slopes), truncated)


def propagated(psf: Psf, slopes: Array) -> Array:
    """Standard uncertainties (n,) by derivatives (n, p or more): by the PSF's parameters, and after them by further
    ones in their standard uncertainties."""
    own, other = np.split(slopes, [len(psf.parameters)], axis=1)
    variance = np.einsum("ij,ij->i", own @ psf.parameter_covariance, own) + np.sum(other**2, axis=1)
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


def _mtf50(psf: Psf, angle: float, without: WithoutPhotosite | None) -> tuple[float, Array, float]:
    """MTF50 along a direction, its derivative, and its standard uncertainty by the model error of the tail."""
    f = without.frequencies(psf, angle) if without else frequencies(psf)
    curve = without.curve if without else mtf_along
    crossing = first_crossing(f, lambda some: curve(psf, some, angle))
    if crossing is None:
        return np.nan, np.full(len(psf.parameters) + (without is not None), np.nan), np.nan
    passed = float(without.passed(crossing[0], angle)) if without else 1.0
    return *crossing, crossing_model_error(psf, crossing[0], lambda some: curve(psf, some, angle), passed)
