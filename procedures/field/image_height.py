"""Sagittal and meridional MTF over image height, the distance from the frame's centre, as makers of lenses print it.

At each height the mean over the directions from the centre that the nodes enclose; a decentred lens differs among
them, which is told beside it. Meridional detail repeats along the radius, sagittal detail across it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.field.maps import radius_direction
from procedures.field.photosite import WithoutPhotosite
from procedures.psf_field import PsfField
from procedures.quality import mtf_along
from procedures.stray_tail import truncation

Array = npt.NDArray[np.float64]

HEIGHTS = 9
DIRECTIONS = 8
"""Places that are looked at: the curves are smooth, as the field between its nodes is."""


@dataclass(frozen=True, eq=False)
class HeightCurve:
    """The MTF at one frequency over image height.

    Attributes
    ----------
    frequency : float
        Cycles per pixel of the plane.
    heights : (n,) float64
        Pixels of the plane from the frame's centre, as far as nodes enclose a direction.
    sagittal, meridional : (n,) float64
        Means over the directions.
    sagittal_uncertainty, meridional_uncertainty : (n,) float64
        Mean standard uncertainties of one place: what the directions' errors have in common is not known.
    sagittal_spread, meridional_spread : (n,) float64
        Standard deviations among the directions.
    directions : (n,) int64
        How many there were.
    """

    frequency: float
    heights: Array
    sagittal: Array
    sagittal_uncertainty: Array
    sagittal_spread: Array
    meridional: Array
    meridional_uncertainty: Array
    meridional_spread: Array
    directions: npt.NDArray[np.int64]


def over_height(
    field: PsfField, frequencies: Sequence[float], without: WithoutPhotosite | None = None
) -> list[HeightCurve]:
    """The MTF at each frequency over image height; empty where the nodes do not enclose the frame's centre.

    Of the camera, or of what comes `without` the photosites: before them.
    """
    centre = np.array([field.shape[1] - 1, field.shape[0] - 1]) / 2
    farthest = float(np.hypot(*centre))
    turns = (np.arange(DIRECTIONS) + 0.5) * 2 * np.pi / DIRECTIONS
    ways = np.column_stack([np.cos(turns), np.sin(turns)])
    heights, found = [], []
    for height in np.linspace(0, farthest, HEIGHTS):
        places = centre + height * ways if height else centre[None]
        enclosed = places[field.inside(places)]
        if len(enclosed):
            heights.append(height)
            found.append(np.array([_at(field, x, y, np.array(frequencies), without) for x, y in enclosed]))
    return [_curve(f, np.array(heights), [one[..., i] for one in found]) for i, f in enumerate(frequencies) if found]


def _at(field: PsfField, x: float, y: float, f: Array, without: WithoutPhotosite | None) -> Array:
    """Sagittal and meridional MTF at a place and their standard uncertainties, (4, frequencies)."""
    psf, radius = field.at(x, y), radius_direction(field.shape, x, y)
    n, rows = len(psf.parameters), []
    for angle in (radius + np.pi / 2, radius):
        value, slope = (without.curve if without else mtf_along)(psf, f, angle)
        of_psf, stray = slope[:, :n], truncation(psf) / (without.passed(f, angle) if without else 1.0)
        variance = np.einsum("ij,ij->i", of_psf @ psf.parameter_covariance, of_psf) + np.sum(slope[:, n:] ** 2, axis=1)
        rows += [value, np.hypot(np.sqrt(np.maximum(variance, 0)), stray)]
    return np.array(rows)


def _curve(frequency: float, heights: Array, found: Sequence[Array]) -> HeightCurve:
    """One curve of every height's places, (places, 4)."""
    means, spreads = (np.array([how(one, axis=0) for one in found]).T for how in (np.mean, np.std))
    s, us, m, um = means
    counts = np.array([len(one) for one in found], dtype=np.int64)
    return HeightCurve(frequency, heights, s, us, spreads[0], m, um, spreads[2], counts)
