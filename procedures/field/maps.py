"""Maps over the frame, drawn from a PSF field: each value with its standard uncertainty.

Sagittal and meridional are about the frame's centre: meridional detail repeats along the radius, sagittal detail across
it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.psf import Psf
from procedures.psf_field import PsfField
from procedures.quality import energy_above_nyquist, mtf50_along

Array = npt.NDArray[np.float64]

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
    value, uncertainty : (ny, nx) float64
        NaN beyond the nodes, and where there is no such number.
    """

    name: str
    title: str
    unit: str
    x: Array
    y: Array
    value: Array
    uncertainty: Array


Number = tuple[float, Array] | None
"""A number drawn from a PSF and its derivative (k^2,) with respect to the samples; None where it has none."""
Function = Callable[[Psf, float], Number]
"""From a PSF and the direction of the radius there, in radians."""


def _sagittal(psf: Psf, radius: float) -> Number:
    return mtf50_along(psf, radius + np.pi / 2)


def _meridional(psf: Psf, radius: float) -> Number:
    return mtf50_along(psf, radius)


def _astigmatism(psf: Psf, radius: float) -> Number:
    sagittal, meridional = _sagittal(psf, radius), _meridional(psf, radius)
    if sagittal is None or meridional is None:
        return None
    return sagittal[0] - meridional[0], sagittal[1] - meridional[1]


def _above_nyquist(psf: Psf, radius: float) -> Number:
    return energy_above_nyquist(psf)


FUNCTIONS: Mapping[str, tuple[str, str, Function]] = {
    "mtf50_sagittal": ("MTF50 of sagittal detail", "cycles/pixel", _sagittal),
    "mtf50_meridional": ("MTF50 of meridional detail", "cycles/pixel", _meridional),
    "astigmatism": ("MTF50, sagittal less meridional", "cycles/pixel", _astigmatism),
    "energy_above_nyquist": ("Energy above Nyquist", "1", _above_nyquist),
}
"""Maps of one plane: title, unit, function."""


def grid(shape: tuple[int, int], columns: int = COLUMNS) -> tuple[Array, Array]:
    """x (nx,) and y (ny,) of places equally spaced over a plane of that shape, its rim left out by half a step."""
    step = max(shape) / columns
    rows, columns = (max(round(size / step), 1) for size in shape)
    x, y = ((np.arange(n) + 0.5) * size / n - 0.5 for n, size in ((columns, shape[1]), (rows, shape[0])))
    return x, y


def radius_direction(shape: tuple[int, int], x: float, y: float) -> float:
    """Direction from the frame's centre to a place of the plane, radians from x towards y."""
    return float(np.arctan2(y - (shape[0] - 1) / 2, x - (shape[1] - 1) / 2))


def derive(field: PsfField, columns: int = COLUMNS) -> tuple[FieldMap, ...]:
    """Every map of one plane."""
    x, y = grid(field.shape, columns)
    value, uncertainty = np.full((2, len(FUNCTIONS), len(y), len(x)), np.nan)
    for row, at_y in enumerate(y):
        for column in np.flatnonzero(field.inside(np.column_stack([x, np.full_like(x, at_y)]))):
            psf = field.at(x[column], at_y)
            numbers = numbers_of(psf, radius_direction(field.shape, x[column], at_y))
            value[:, row, column], uncertainty[:, row, column] = numbers
    return tuple(
        FieldMap(name, title, unit, x, y, value[i], uncertainty[i])
        for i, (name, (title, unit, _)) in enumerate(FUNCTIONS.items())
    )


def numbers_of(psf: Psf, radius: float) -> tuple[Array, Array]:
    """The numbers of all maps at one place, and their standard uncertainties; NaN where there is none."""
    value, slopes = np.full(len(FUNCTIONS), np.nan), np.full((len(FUNCTIONS), psf.k**2), np.nan)
    for i, (_, _, function) in enumerate(FUNCTIONS.values()):
        number = function(psf, radius)
        if number is not None:
            value[i], slopes[i] = number
    variance = np.einsum("ij,ij->i", slopes @ psf.covariance, slopes)
    return value, np.sqrt(np.maximum(variance, 0))
