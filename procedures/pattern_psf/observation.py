"""Samples of the noise region from which the PSF is estimated: position, value and weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.warps import cubic_monomials
from procedures.pattern import BLOCK, CELLS
from procedures.pattern_psf.radiometry import LightLevels, quadratic
from procedures.pattern_psf.rasterise import Window
from procedures.pattern_psf.registration import Registration

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Observation:
    """Samples of the fit: their positions, and their values between black (0) and white (1).

    Attributes
    ----------
    rows, columns : (m,) int64
        Pixels, relative to the window.
    points : (m, 2) float64
        Positions (x, y) in the plane.
    y : (m,) float64
        Samples, black 0, white 1.
    weight : (m,) float64
        Reciprocal of the noise of y.
    quadratics : (m, 6) float64, cubics : (m, 9) float64
        Monomials of light and displacement at the registration's normalised coordinates.
    """

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]
    points: Array
    y: Array
    weight: Array
    quadratics: Array
    cubics: Array

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.y)

    def where(self, kept: npt.NDArray[np.bool_] | slice) -> Observation:
        """Subset of the samples."""
        return Observation(
            self.rows[kept],
            self.columns[kept],
            self.points[kept],
            self.y[kept],
            self.weight[kept],
            self.quadratics[kept],
            self.cubics[kept],
        )


def noise_window(registration: Registration, shape: tuple[int, ...]) -> Window:
    """Bounding box of the noise region, clipped to the plane."""
    return _window(registration, shape, 0.0, 0.0)


def surroundings(registration: Registration, shape: tuple[int, ...]) -> Window:
    """Bounding box of the chart with its frame and half of its width around it, clipped to the plane."""
    return _window(registration, shape, float(BLOCK), 0.5)


def _window(registration: Registration, shape: tuple[int, ...], frame: float, wider: float) -> Window:
    """Bounding box of the noise region with `frame` cells around it, enlarged by `wider` of its size on each side."""
    low, high = -frame, CELLS + frame
    rim = registration.to_sensor(np.array([[low, low], [high, low], [high, high], [low, high]]))
    limit = np.array(shape[::-1]) - 1
    more = wider * np.ptp(rim, axis=0)
    first = np.clip(np.floor(rim.min(axis=0) - more), 0, limit).astype(int)
    last = np.clip(np.ceil(rim.max(axis=0) + more), 0, limit).astype(int)
    return Window(int(first[0]), int(first[1]), int(last[0] - first[0] + 1), int(last[1] - first[1] + 1))


def observe(
    samples: Array32, registration: Registration, light: LightLevels, window: Window, *, margin_px: float = 0.0
) -> Observation:
    """The samples of the noise region, scaled between black and white, with their weights.

    Parameters
    ----------
    margin_px : float
        Width of the border excluded: the PSF's radius, where marks are hidden and the surroundings are not known.
    """
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
    x, y = np.meshgrid(np.arange(window.columns), np.arange(window.rows))
    columns, rows = x.ravel(), y.ravel()
    points = np.column_stack([columns + window.x, rows + window.y]).astype(np.float64)
    u, v = registration.to_pattern(points).T
    margin = margin_px * np.abs(registration.jacobian()).sum(axis=1).max()
    inside = (u >= margin) & (u <= CELLS - margin) & (v >= margin) & (v <= CELLS - margin)
    return rows[inside], columns[inside]
