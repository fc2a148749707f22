"""Light on the chart: black and white levels over the plane, the noise of the pixels, the camera's response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.pattern import BLACK_BLOCKS, BLOCK, WHITE_BLOCKS, block_corner
from procedures.pattern_psf.registration import Registration, block_size_px

Array = npt.NDArray[np.float64]

CLIPPED = 0.998
"""Samples from here on count as saturated: white is 1, and gain corrections leave a few steps of play."""


@dataclass(frozen=True)
class Light:
    """Levels of black and white over the plane, and the noise on them.

    Attributes
    ----------
    black, white : (6,) float64
        Coefficients of `quadratic` at the normalised coordinates of the registration, in samples of the plane.
    variance_black, variance_white : float
        Variance of the samples about black and white, in samples squared.
    saturated : float
        Share of the white blocks' samples that are clipped.
    flatness : float
        Smallest white level over largest, on the blocks.
    """

    black: Array
    white: Array
    variance_black: float
    variance_white: float
    saturated: float
    flatness: float

    @property
    def contrast(self) -> float:
        """White minus black at the chart's centre, in samples of the plane."""
        return float(self.white[0] - self.black[0])

    def variance_at(self, level: Array) -> Array:
        """Noise variance at levels between black (0) and white (1): linear, as photon and read noise make it."""
        slope = max(self.variance_white - self.variance_black, 0.0)
        return np.asarray(self.variance_black + slope * np.clip(level, 0, 1))


def quadratic(x: Array, y: Array) -> Array:
    """The six monomials up to degree two at points (n,): (n, 6). Source: IPOL 2012, section 4.4."""
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def measure_light(samples: npt.NDArray[np.float32], registration: Registration) -> Light:
    """Black and white levels as second-order polynomials of place, from the black and white blocks of the frame.

    Parameters
    ----------
    samples : (rows, columns) float32
        The plane.

    References
    ----------
    Delbracio, Muse, Almansa, IPOL 2012, section 4.4.
    """
    black, variance_black, _ = _fit_blocks(samples, registration, BLACK_BLOCKS)
    white, variance_white, whites = _fit_blocks(samples, registration, WHITE_BLOCKS)
    levels = np.array([np.median(block) for block in whites])
    # a step of quantisation is noise too: identical samples must not claim to be free of it
    floor = 1e-12
    return Light(
        black,
        white,
        max(variance_black, floor),
        max(variance_white, floor),
        float(np.mean(np.concatenate(whites) >= CLIPPED)),
        float(levels.min() / levels.max()) if levels.max() > 0 else 0.0,
    )


def _fit_blocks(
    samples: npt.NDArray[np.float32], registration: Registration, blocks: tuple[tuple[int, int], ...]
) -> tuple[Array, float, list[Array]]:
    """Quadratic through the blocks' inner pixels, their variance about a plane per block, and their values."""
    margin = BLOCK * min(0.3, 2.0 / block_size_px(registration))
    designs, values, square, freedom = [], [], 0.0, 0
    for column, row in blocks:
        points = _pixels_in_square(registration, np.array(block_corner(column, row)) + margin, BLOCK - 2 * margin)
        inside = ((points >= 0) & (points < np.array(samples.shape)[::-1])).all(axis=1)
        points = points[inside]
        value = samples[points[:, 1], points[:, 0]].astype(np.float64)
        design = quadratic(*((points - registration.centre) / registration.radius).T)
        if len(value) > 6:
            left = value - design[:, :3] @ np.linalg.lstsq(design[:, :3], value, rcond=None)[0]
            square += float(left @ left)
            freedom += len(value) - 3
        designs.append(design)
        values.append(value)
    coefficients = _robust_fit(designs, values)
    return coefficients, square / max(freedom, 1), values


def _robust_fit(designs: list[Array], values: list[Array]) -> Array:
    """Least squares over all blocks without those (hidden, shaded) whose mean is far from the others' fit."""
    used = [i for i, value in enumerate(values) if len(value)]
    design = np.array([designs[i].mean(axis=0) for i in used])
    level = np.array([values[i].mean() for i in used])
    weight = np.ones(len(used))
    for _ in range(10):
        fit = np.linalg.lstsq(design * weight[:, None], level * weight, rcond=None)[0]
        left = np.abs(level - design @ fit)
        weight = 1 / np.sqrt(1 + (left / (2 * np.median(left) + 1e-4)) ** 4)
    kept = [used[i] for i in np.flatnonzero(weight > 0.2)]
    return np.asarray(
        np.linalg.lstsq(np.vstack([designs[i] for i in kept]), np.concatenate([values[i] for i in kept]), rcond=None)[0]
    )


def _pixels_in_square(registration: Registration, corner: Array, side: float) -> npt.NDArray[np.int64]:
    """Pixels (x, y) of the plane that lie inside a square of the chart, given its top left corner and side in cells."""
    rim = corner + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    polygon = registration.to_sensor(rim)
    low, high = np.ceil(polygon.min(axis=0)).astype(int), np.floor(polygon.max(axis=0)).astype(int)
    x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    points = np.column_stack([x.ravel(), y.ravel()])
    cells = registration.to_pattern(points.astype(np.float64))
    return np.asarray(points[((cells >= corner) & (cells <= corner + side)).all(axis=1)])


def response_curvature(level: Array, mean_of_cells: float) -> float:
    """Curvature beta of the response m -> m + beta (m^2 - m) that explains the noise region's mean.

    Parameters
    ----------
    level : (m,) float64
        Samples of the noise region, black 0, white 1.
    mean_of_cells : float
        Share of white cells: what the mean would be through a linear camera, since the PSF sums to one.

    Raises
    ------
    ValueError
        If the samples are binary: no curvature can be seen in them.

    Notes
    -----
    The paper corrects the photograph, u -> alpha u^2 + (1 - alpha) u with alpha = (1/2 - mean u) / mean(u^2 - u);
    here the parabola acts on the prediction, so that the noise stays as the sensor made it. To first order
    beta = -alpha.

    References
    ----------
    Delbracio, Muse, Almansa, IPOL 2012, section 4.5.
    """
    bend = float(np.mean(level**2 - level))
    if abs(bend) < 1e-9:
        raise ValueError("the response needs samples between black and white; got a binary image")
    return (float(level.mean()) - mean_of_cells) / bend
