"""Measured point spread functions as shapes of blur: a single one, or a field of them over the frame (4.4).

A PSF measured at one defocus is used, stretched, as the shape at every other (4.12, 4.20): valid where defocus exceeds
diffraction and the photosite, which do not grow with it. w is the half-width of the measured PSF's support, so that at
this w the masks are the measured PSF itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput
from procedures.psf_field import PsfField
from procedures.reading.arrays import SMALLEST, checked_number
from procedures.restoration.masks.blur_models import as_shape, odd_square
from procedures.restoration.masks.mask_fields import positions
from procedures.restoration.masks.shape_fields import GRID, ShapeField, symmetric

SHARE = 0.99
"""Fraction of the light inside the samples that lies in a shape's support."""


@dataclass(frozen=True)
class MeasuredShape(ShapeField):
    """Shapes over the frame, and the half-width in pixels of their PSFs.

    cut : the largest negative fraction of a PSF's light, set to zero together with as much positive noise.
    energy_outside_support : the largest fraction of a PSF's light outside its samples, and in no shape; None if not
        known.
    """

    half_width_px: float
    cut: float
    energy_outside_support: float | None = None


def measured_shape(h: Array, samples_per_px: float) -> MeasuredShape:
    """A PSF (k, k) as a shape. Raises BadInput as `odd_square`."""
    return _shapes([[h]], samples_per_px)


def measured_heights(psfs: Sequence[Array], samples_per_px: float, shape: tuple[int, int]) -> MeasuredShape:
    """PSFs at equal heights from the centre of the frame to its corner as shapes over it, see `symmetric`."""
    radial = _shapes([psfs], samples_per_px)
    return replace(radial, shapes=symmetric(radial.shapes[0], shape).shapes)


def measured_field(field: PsfField, shape: tuple[int, int], grid: tuple[int, int] = GRID) -> MeasuredShape:
    """The PSFs of a field over a photograph (H, W) as shapes of their support's half-width, beyond its nodes those of
    the nearest position. Raises BadInput for another size."""
    if tuple(field.shape) != shape:
        raise BadInput(
            f"photographs need the size of the field's plane, {field.shape[1]} x {field.shape[0]}; they are "
            f"{shape[1]} x {shape[0]}",
            "give whole photographs, and the field of this camera's plane",
        )
    rows, columns = positions(grid, shape, 0)
    places = np.array([[x, y] for y in rows for x in columns])
    samples = field.samples(places).reshape(*grid, field.k, field.k)
    outside = float(field.energy_outside(places).max()) if field.q else None
    return replace(_shapes([list(row) for row in samples], field.s), energy_outside_support=outside)


def _shapes(psfs: Sequence[Sequence[Array]], samples_per_px: float) -> MeasuredShape:
    checked_number(samples_per_px, "the samples per pixel of a measured PSF", SMALLEST)
    psfs = [[odd_square(h, "a measured PSF", remedy="give the psf_P.npy of a result") for h in row] for row in psfs]
    clean = [[without_noise(h) for h in row] for row in psfs]
    half = max(_support(h) for row in clean for h in row) + 0.5
    cut = max(float(-np.minimum(h, 0).sum() / h.sum()) for row in psfs for h in row)
    shapes = tuple(tuple(np.asarray(as_shape(h, half), np.float64) for h in row) for row in clean)
    return MeasuredShape(shapes, half / samples_per_px, cut)


def without_noise(h: Array) -> Array:
    """The samples that exceed the magnitude of the most negative one, as light is not negative and noise is."""
    noise = max(float(-h.min()), 0.0)
    clean = np.where(h > noise, h, 0.0)
    return clean if clean.any() else np.maximum(h, 0.0)


def _support(h: Array) -> int:
    """Samples from the centre to the side of the square that contains the light."""
    k = len(h) // 2
    distance = np.abs(np.arange(-k, k + 1))
    light = np.bincount(np.maximum(distance[:, None], distance[None, :]).ravel(), h.ravel())
    return int(np.searchsorted(np.cumsum(light), SHARE * light.sum()))
