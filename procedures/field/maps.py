"""Maps over the frame, drawn from a PSF field: each value with its standard uncertainty, each of the whole PSF.

Sagittal and meridional are about the frame's centre: meridional detail repeats along the radius, sagittal detail across
it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.field.photosite import WithoutPhotosite
from procedures.numbers import (
    ENERGY_ABOVE_NYQUIST,
    ENERGY_OUTSIDE_SUPPORT,
    ERROR_INTERPOLATION,
    ERROR_NOISE,
    OF_PLACES,
    without_photosite,
)
from procedures.psf import Psf
from procedures.psf_field import PsfField
from procedures.quality import frequencies, mtf_along
from procedures.spatial_numbers import energy_above_nyquist
from procedures.stray_tail import tail_energy_uncertainty, truncation
from procedures.transfer_function import first_crossing

Array = npt.NDArray[np.float64]

STEP = 0.005
"""Cycles per pixel on both sides of MTF50 between which the curve's slope is taken."""
COLUMNS = 21
"""Places of a map along the frame's longer side."""


@dataclass(frozen=True, eq=False)
class FieldMap:
    """A number over the frame.

    Attributes
    ----------
    name, title, unit : str
        For programs, for people, and what it counts.
    x : (nx,), y : (ny,) float64
        Places in pixels of the plane.
    value : (ny, nx) float64
        NaN where there is no such number.
    uncertainty : (ny, nx) float64 or None
        None where the value is itself an uncertainty.
    enclosed : (ny, nx) bool or None
        Which places the nodes enclose, where the others have a value too; None: those that have one.
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
        """The share of the frame that the nodes enclose."""
        return float((np.isfinite(self.value) if self.enclosed is None else self.enclosed).mean())

    def median(self, values: Array) -> float:
        """Of values (ny, nx) at the map's places, those that the nodes enclose; NaN where there are none."""
        some = values if self.enclosed is None else values[self.enclosed]
        return float(np.nanmedian(some)) if np.isfinite(some).any() else np.nan


MAPS = (*OF_PLACES, ENERGY_ABOVE_NYQUIST, ENERGY_OUTSIDE_SUPPORT)
"""Maps of numbers drawn from the PSF."""
BEFORE_PHOTOSITES = tuple(without_photosite(one) for one in OF_PLACES)
"""The same of what comes before the photosites, where that is asked for: lens, filters, and charge that wanders."""


def grid(shape: tuple[int, int], columns: int = COLUMNS) -> tuple[Array, Array]:
    """x (nx,) and y (ny,) of places equally spaced over a plane of that shape, its rim left out by half a step."""
    step = max(shape) / columns
    rows, columns = (max(round(size / step), 1) for size in shape)
    x, y = ((np.arange(n) + 0.5) * size / n - 0.5 for n, size in ((columns, shape[1]), (rows, shape[0])))
    return x, y


def radius_direction(shape: tuple[int, int], x: float, y: float) -> float:
    """Direction from the frame's centre to a place of the plane, radians from x towards y."""
    return float(np.arctan2(y - (shape[0] - 1) / 2, x - (shape[1] - 1) / 2))


ERRORS = (ERROR_NOISE, ERROR_INTERPOLATION)
"""Maps of the field's own error: its norm over that of the PSF."""


def derive(field: PsfField, columns: int = COLUMNS, without: WithoutPhotosite | None = None) -> tuple[FieldMap, ...]:
    """Every map of one plane, those without the photosite where these are asked for, and the predicted error's last.

    Beyond the nodes they are what `PsfField.at` tells.
    """
    x, y = grid(field.shape, columns)
    names = (*MAPS, *BEFORE_PHOTOSITES) if without else MAPS
    value, uncertainty = np.full((2, len(names), len(y), len(x)), np.nan)
    errors = np.full((len(ERRORS), len(y), len(x)), np.nan)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    enclosed = field.inside(places).reshape(len(y), len(x))
    parameters = field.parameters(places).reshape(len(y), len(x), -1)
    for row, at_y in enumerate(y):
        for column in range(len(x)):
            parts = field.covariances(x[column], at_y)
            psf = Psf.of(parameters[row, column], parts[0] + parts[1], field.k, field.s, parts[1])
            norm = float(np.linalg.norm(psf.extended()))
            errors[:, row, column] = [field.norm_of_error(C) / norm for C in parts]
            radius = radius_direction(field.shape, x[column], at_y)
            numbers = [numbers_of(psf, radius)] + ([mtf50_about(psf, radius, without)] if without else [])
            value[:, row, column], uncertainty[:, row, column] = np.hstack(numbers)
    numbered = zip(names, value, uncertainty, strict=True)
    maps = [FieldMap(one, one.label, one.unit, x, y, v, u, enclosed) for one, v, u in numbered]
    told = zip(ERRORS, errors, strict=True)
    return (*maps, *(FieldMap(one, one.label, one.unit, x, y, v, None, enclosed) for one, v in told))


def numbers_of(psf: Psf, radius: float) -> tuple[Array, Array]:
    """The numbers of MAPS at one place, and their standard uncertainties; NaN where there is none.

    What the tail's few shapes leave out is in the uncertainties: it is the same at all nodes.
    `radius` is the direction from the frame's centre, in radians.
    """
    values, uncertainties = mtf50_about(psf, radius)
    above, slope = energy_above_nyquist(psf)
    of_above = np.sqrt(max(float(slope @ psf.parameter_covariance @ slope), 0.0))
    outside, noise = psf.energy_outside if len(psf.tail.amplitudes) else (np.nan, np.nan)
    u_outside = np.hypot(noise, tail_energy_uncertainty(psf))
    return np.append(values, [above, outside]), np.append(uncertainties, [of_above, u_outside])


def mtf50_about(psf: Psf, radius: float, without: WithoutPhotosite | None = None) -> tuple[Array, Array]:
    """MTF50 of sagittal detail, of meridional detail, and their difference (3,), and standard uncertainties (3,).

    Of the camera, or of what comes before the photosites; NaN where the MTF stays above 1/2.
    """
    two = [_mtf50(psf, angle, without) for angle in (radius + np.pi / 2, radius)]
    (sagittal, by_sagittal, left_s), (meridional, by_meridional, left_m) = two
    slopes, n = np.array([by_sagittal, by_meridional, by_sagittal - by_meridional]), len(psf.parameters)
    of_psf = slopes[:, :n]
    # what follows the PSF's parameters is counted in its standard uncertainties
    variance = np.einsum("ij,ij->i", of_psf @ psf.parameter_covariance, of_psf) + np.sum(slopes[:, n:] ** 2, axis=1)
    left_out = np.array([left_s, left_m, np.hypot(left_s, left_m)])
    return np.array([sagittal, meridional, sagittal - meridional]), np.hypot(np.sqrt(np.maximum(variance, 0)), left_out)


def _mtf50(psf: Psf, angle: float, without: WithoutPhotosite | None) -> tuple[float, Array, float]:
    """MTF50 along a direction, its derivative, and its standard uncertainty by what the tail's shapes leave out."""
    f = without.frequencies(psf, angle) if without else frequencies(psf)
    curve = without.curve if without else mtf_along
    found = first_crossing(f, lambda some: curve(psf, some, angle))
    if found is None:
        return np.nan, np.full(len(psf.parameters) + (without is not None), np.nan), np.nan
    before, after = curve(psf, found[0] + np.array([-STEP, STEP]), angle)[0]
    stray = truncation(psf) / (float(without.passed(found[0], angle)) if without else 1.0)
    return *found, stray * 2 * STEP / max(float(before - after), 1e-9)
