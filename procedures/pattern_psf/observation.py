"""Samples of the noise region from which the PSF is estimated: position, value and weight."""

from dataclasses import dataclass, fields

import numpy as np

from procedures.numerics.arrays import Array, Array32, Indices, Mask
from procedures.numerics.warps import cubic_monomials
from procedures.pattern import BLOCK, CELLS
from procedures.pattern_psf.radiometry import LightLevels, quadratic
from procedures.pattern_psf.rasterise import Window
from procedures.pattern_psf.registration import Registration


@dataclass(frozen=True)
class Observation:
    """Samples of the fit: their positions, and their values between black (0) and white (1).

    rows, columns : (m,) int64 pixels, relative to the window
    points : (m, 2) positions (x, y) in the plane
    y : (m,) samples, black 0, white 1
    weight : (m,) reciprocal of the noise of y
    quadratics : (m, 6) float64, cubics : (m, 9) float64; monomials of light and displacement at the registration's
        normalised coordinates
    """

    rows: Indices
    columns: Indices
    points: Array
    y: Array
    weight: Array
    quadratics: Array
    cubics: Array

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.y)

    @property
    def window(self) -> Window:
        """The samples' window, up to its last row and column."""
        x, y = (self.points[0] - (self.columns[0], self.rows[0])).astype(int)
        return Window(int(x), int(y), int(self.columns.max()) + 1, int(self.rows.max()) + 1)

    def where(self, kept: Mask | slice) -> "Observation":
        """Subset of the samples."""
        return Observation(*(getattr(self, field.name)[kept] for field in fields(self)))


def noise_window(registration: Registration, shape: tuple[int, ...]) -> Window:
    """Bounding box of the noise region, clipped to the plane."""
    return Window.around(registration, shape, 0.0, 0.0)


def surroundings(registration: Registration, shape: tuple[int, ...]) -> Window:
    """Bounding box of the chart with its frame and half of its width around it, clipped to the plane."""
    return Window.around(registration, shape, float(BLOCK), 0.5)


def observe(
    samples: Array32, registration: Registration, light: LightLevels, window: Window, *, margin_px: float = 0.0
) -> Observation:
    """The samples of the noise region, scaled between black and white, with their weights, less a border of the PSF's
    radius, where surroundings are unknown."""
    rows, columns = _inside(registration, window, margin_px)
    points = np.column_stack([columns + window.x, rows + window.y]).astype(np.float64)
    place = ((points - registration.centre) / registration.radius).T
    quadratics = quadratic(*place)
    contrast = quadratics @ (light.white - light.black)
    value = (window.cut(samples)[rows, columns] - quadratics @ light.black) / contrast
    weight = contrast / np.sqrt(light.variance_at(value))
    return Observation(rows, columns, points, value, weight, quadratics, cubic_monomials(*place))


def count_inside(registration: Registration, window: Window) -> int:
    """Number of samples of a window in the noise region."""
    return len(_inside(registration, window, 0.0)[0])


def _inside(registration: Registration, window: Window, margin_px: float) -> tuple[Indices, Indices]:
    """Rows and columns (m,) of the window's pixels in the noise region, away from its border."""
    pixels = window.pixels()
    u, v = registration.to_pattern(pixels.astype(np.float64)).T
    margin = margin_px * np.abs(registration.jacobian()).sum(axis=1).max()
    inside = (u >= margin) & (u <= CELLS - margin) & (v >= margin) & (v <= CELLS - margin)
    columns, rows = (pixels[inside] - (window.x, window.y)).T
    return rows, columns
