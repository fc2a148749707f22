"""Sagittal and meridional MTF as functions of the image height, the distance from the frame's centre.

Each value is the mean over the directions from the centre inside the nodes' hull, with the spread among them, by which
a decentred lens shows. Meridional detail repeats along the radius, sagittal detail across it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.field.maps import propagated, radius_direction
from procedures.field.photosite import WithoutPhotosite
from procedures.numerics.arrays import Array
from procedures.psf_field import PsfField
from procedures.quality import mtf_along
from procedures.stray_tail import curve_model_error

HEIGHTS = 9
DIRECTIONS = 8  # sampling of the curves, which are as smooth as the interpolated field


@dataclass(frozen=True, eq=False)
class HeightCurve:
    """MTF at one frequency as a function of the image height.

    frequency : cycles per pixel of the plane
    heights : (n,), pixels of the plane from the frame's centre
    sagittal, meridional : (n,), means over the directions
    sagittal_uncertainty, meridional_uncertainty : (n,) mean standard uncertainties of one position: the correlation
        between directions is unknown
    sagittal_spread, meridional_spread : (n,), standard deviations among the directions
    directions : (n,), number of directions inside the hull
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
    """MTF of the camera, or `without` the photosites, at each frequency; empty where the hull excludes the centre."""
    centre = np.array([field.shape[1] - 1, field.shape[0] - 1]) / 2
    farthest = float(np.hypot(*centre))
    angles = (np.arange(DIRECTIONS) + 0.5) * 2 * np.pi / DIRECTIONS
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    heights, values = [], []
    for height in np.linspace(0, farthest, HEIGHTS):
        places = centre + height * directions if height else centre[None]
        enclosed = places[field.inside(places)]
        if len(enclosed):
            heights.append(height)
            values.append(np.array([_at(field, x, y, np.array(frequencies), without) for x, y in enclosed]))
    if not heights:
        return []
    means, spreads = (np.array([how(v, axis=0) for v in values]) for how in (np.mean, np.std))
    counts = np.array([len(v) for v in values], dtype=np.int64)
    curves = []
    for i, f in enumerate(frequencies):
        (s, us, m, um), (spread_s, _, spread_m, _) = means[..., i].T, spreads[..., i].T
        curves.append(HeightCurve(f, np.array(heights), s, us, spread_s, m, um, spread_m, counts))
    return curves


def _at(field: PsfField, x: float, y: float, f: Array, without: WithoutPhotosite | None) -> Array:
    """Sagittal MTF, its standard uncertainty, and the same of meridional MTF at a position, (4, frequencies)."""
    psf, radius = field.at(x, y), radius_direction(field.shape, x, y)
    rows = []
    for angle in (radius + np.pi / 2, radius):
        value, slope = (without.curve if without else mtf_along)(psf, f, angle)
        passed = without.passed(f, angle) if without else np.ones(len(f))
        rows += [value, np.hypot(propagated(psf, slope), curve_model_error(psf, f, value * passed, slope, passed))]
    return np.array(rows)
