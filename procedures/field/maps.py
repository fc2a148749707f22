"""Maps over the frame, drawn from a PSF field: each value with its standard uncertainty, each of the whole PSF.

Sagittal and meridional are about the frame's centre: meridional detail repeats along the radius, sagittal detail across
it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.psf import Psf
from procedures.psf_field import PsfField
from procedures.quality import mtf50_along, mtf_along, stray_energy, truncation
from procedures.spatial_numbers import energy_above_nyquist

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


MAPS = (
    ("mtf50_sagittal", "MTF50 of sagittal detail", "cycles/pixel"),
    ("mtf50_meridional", "MTF50 of meridional detail", "cycles/pixel"),
    ("astigmatism", "MTF50, sagittal less meridional", "cycles/pixel"),
    ("energy_above_nyquist", "Energy above Nyquist", "1"),
    ("energy_outside_support", "Energy outside the support of the samples", "1"),
)
"""Maps of numbers drawn from the PSF: name, title, unit."""


def grid(shape: tuple[int, int], columns: int = COLUMNS) -> tuple[Array, Array]:
    """x (nx,) and y (ny,) of places equally spaced over a plane of that shape, its rim left out by half a step."""
    step = max(shape) / columns
    rows, columns = (max(round(size / step), 1) for size in shape)
    x, y = ((np.arange(n) + 0.5) * size / n - 0.5 for n, size in ((columns, shape[1]), (rows, shape[0])))
    return x, y


def radius_direction(shape: tuple[int, int], x: float, y: float) -> float:
    """Direction from the frame's centre to a place of the plane, radians from x towards y."""
    return float(np.arctan2(y - (shape[0] - 1) / 2, x - (shape[1] - 1) / 2))


ERRORS = (
    ("error_noise", "error from noise"),
    ("error_interpolation", "error from interpolation"),
)
"""Maps of the field's own error: its norm over that of the PSF."""


def derive(field: PsfField, columns: int = COLUMNS) -> tuple[FieldMap, ...]:
    """Every map of one plane, and those of the predicted error last; beyond the nodes by what `PsfField.at` tells."""
    x, y = grid(field.shape, columns)
    value, uncertainty = np.full((2, len(MAPS), len(y), len(x)), np.nan)
    errors = np.full((len(ERRORS), len(y), len(x)), np.nan)
    enclosed = field.inside(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(len(y), len(x))
    for row, at_y in enumerate(y):
        for column in range(len(x)):
            p = field.parameters(np.array([[x[column], at_y]]))[0]
            parts = field.noise(x[column], at_y), field.interpolation(x[column], at_y)
            psf = Psf.of(p, parts[0] + parts[1], field.k, field.s, parts[1])
            norm = float(np.linalg.norm(psf.extended()))
            errors[:, row, column] = [field.norm_of_error(C) / norm for C in parts]
            numbers = numbers_of(psf, radius_direction(field.shape, x[column], at_y))
            value[:, row, column], uncertainty[:, row, column] = numbers
    numbered = zip(MAPS, value, uncertainty, strict=True)
    maps = [FieldMap(name, title, unit, x, y, v, u, enclosed) for (name, title, unit), v, u in numbered]
    told = zip(ERRORS, errors, strict=True)
    return (*maps, *(FieldMap(name, title, "of the PSF's norm", x, y, v, None, enclosed) for (name, title), v in told))


def numbers_of(psf: Psf, radius: float) -> tuple[Array, Array]:
    """The numbers of MAPS at one place, and their standard uncertainties; NaN where there is none.

    What the tail's few shapes leave out is in the uncertainties: it is the same at all nodes.
    `radius` is the direction from the frame's centre, in radians.
    """
    angles = (radius + np.pi / 2, radius)
    sagittal, meridional = (mtf50_along(psf, angle) or _none(psf) for angle in angles)
    astigmatism = sagittal[0] - meridional[0], sagittal[1] - meridional[1]
    numbers = (sagittal, meridional, astigmatism, energy_above_nyquist(psf))
    slopes = np.array([slope for _, slope in numbers])
    variance = np.einsum("ij,ij->i", slopes @ psf.parameter_covariance, slopes)
    left_out = [_left_out(psf, one[0], angle) for one, angle in zip((sagittal, meridional), angles, strict=True)]
    uncertainty = np.hypot(np.sqrt(np.maximum(variance, 0)), np.array([*left_out, np.linalg.norm(left_out), 0.0]))
    outside, noise = psf.energy_outside if len(psf.tail.amplitudes) else (np.nan, np.nan)
    values = np.array([*(value for value, _ in numbers), outside])
    return values, np.append(uncertainty, np.hypot(noise, stray_energy(psf)))


def _left_out(psf: Psf, mtf50: float, angle: float) -> float:
    """Standard uncertainty of an MTF50 by what the tail's shapes leave out of the OTF; NaN where there is none."""
    if not np.isfinite(mtf50):
        return np.nan
    before, after = mtf_along(psf, mtf50 + np.array([-STEP, STEP]), angle)[0]
    return truncation(psf) * 2 * STEP / max(float(before - after), 1e-9)


def _none(psf: Psf) -> tuple[float, Array]:
    return np.nan, np.full(len(psf.parameters), np.nan)
