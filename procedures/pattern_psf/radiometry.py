"""Radiometry of the chart: black and white levels over the plane, noise of the pixels, clipping."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from procedures.clipping import SensorModel, find_clipping
from procedures.numerics.arrays import Array, Array32, Indices, Mask, quantile
from procedures.outcome import Refused
from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, WHITE_BLOCKS
from procedures.pattern_psf.rasterise import Window
from procedures.pattern_psf.registration import Registration, block_size_px
from procedures.raw import Plane

OUTLIER_SIGMAS = 6.0
"""Robust standard deviations, and digital numbers, beyond which a block's sample is an outlier of its surface."""
MIN_SAMPLES = 12
"""Samples of a block above which a surface of degree two is fitted to them, and outliers are searched for; for fewer
than half of them it is a constant, for those between a plane."""
MAX_SIGNAL_SHARE = 0.97  # share of the saturation signal up to which the response is known
MIN_BEND_UNCERTAINTY = 1e-4  # least uncertainty of the response's curvature: the model error of its polynomial


@dataclass(frozen=True)
class LightLevels:
    """Levels of black and white over the plane, and their noise.

    black, white : (6,) coefficients of `quadratic` at the normalised coordinates of the registration, in samples of the
        plane
    variance_black, variance_white : variance of the samples about black and white, in samples squared
    saturated : share of the white blocks' samples that are clipped
    flatness : smallest white level over largest, on the blocks
    crushed : share of the black blocks' samples that are clipped
    noise_correlation : noise correlation of neighbouring samples in the blocks, the larger of rows and columns
    variance_middle : variance half way between black and white, where known from the sensor's calibration
    """

    black: Array
    white: Array
    variance_black: float
    variance_white: float
    saturated: float
    flatness: float
    crushed: float = 0.0
    noise_correlation: float = 0.0
    variance_middle: float | None = None

    @property
    def contrast(self) -> float:
        """White minus black at the chart's centre, in samples of the plane."""
        return float(self.white[0] - self.black[0])

    def variance_at(self, level: Array) -> Array:
        """Noise variance at levels from 0 to 1: linear, by photon and read noise, or a parabola where half way is
        known."""
        slope, inside = max(self.variance_white - self.variance_black, 0.0), np.clip(level, 0, 1)
        variance = self.variance_black + slope * inside
        if self.variance_middle is None:
            return np.asarray(variance)
        sag = self.variance_middle - (self.variance_black + self.variance_white) / 2
        return np.asarray(variance + 4 * sag * inside * (1 - inside))


def quadratic(x: Array, y: Array) -> Array:
    """Monomials up to degree two at points (n,): (n, 6). Source: IPOL 2012, section 4.4."""
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def measure_light(samples: Array32, registration: Registration, quantisation: float) -> LightLevels:
    """Fit black and white levels, polynomials of degree two in position, to the black and white blocks of the frame.

    samples : (rows, columns) float32 the plane
    quantisation : one digital number in the plane's units; rounding is a lower limit of the noise

    Source: Delbracio, Muse, Almansa, IPOL 2012, section 4.4.
    """
    points, block = _block_pixels(registration, samples.shape)
    block_at = _block_reader(samples, registration, points, block, quantisation)
    black, variance_black, in_black = _fit_blocks(block_at, BLACK_BLOCKS)
    white, variance_white, in_white = _fit_blocks(block_at, WHITE_BLOCKS)
    blacks, whites = ([block_at(block).value for block in places] for places in (BLACK_BLOCKS, WHITE_BLOCKS))
    levels = np.array([quantile(value, 0.5) for value in whites if len(value)])
    floor = quantisation**2 / 12
    dark, bright = float(np.sqrt(variance_black)), float(np.sqrt(variance_white))
    clipped = find_clipping(np.concatenate(whites), quantisation, dark_noise=dark)
    crushed = find_clipping(np.concatenate(blacks), quantisation, bright_noise=bright)
    return LightLevels(
        black,
        white,
        max(variance_black, floor),
        max(variance_white, floor),
        clipped.white,
        float(levels.min() / levels.max()) if levels.max() > 0 else 0.0,
        crushed.black,
        max(in_black, in_white, key=abs) if min(variance_black, variance_white) > 2 * floor else in_white,
    )


def with_sensor(light: LightLevels, sensor: SensorModel, plane: Plane) -> LightLevels:
    """Noise at black and white of a linearised plane by the sensor's calibration. Raises Refused if white saturates."""
    levels = np.array([light.black[0], (light.black[0] + light.white[0]) / 2, light.white[0]])
    straight = levels / plane.quantisation + plane.black - sensor.dark_level
    signal = sensor.bent(straight)
    if signal[2] > MAX_SIGNAL_SHARE * sensor.saturation:
        raise Refused(
            f"the chart's white must lie below {MAX_SIGNAL_SHARE:.0%} of the sensor's saturation; it lies at "
            f"{signal[2] / sensor.saturation:.0%}",
            "reduce the exposure until white lies at 80 % of full scale",
        )
    black, middle, white = (float(v) for v in sensor.linearised_variance(straight) * plane.quantisation**2)
    return replace(light, variance_black=black, variance_middle=middle, variance_white=white)


def straighten(plane: Plane, sensor: SensorModel) -> Plane:
    """Plane linearised by the sensor's response."""
    signal = plane.samples / plane.quantisation + (plane.black - sensor.dark_level)
    straight = sensor.linearised(signal) - (plane.black - sensor.dark_level)
    return replace(plane, samples=(straight * plane.quantisation).astype(np.float32))


def bend_of_chart(light: LightLevels, sensor: SensorModel, plane: Plane) -> float:
    """Standard uncertainty of beta over the chart's contrast by the sensor's calibration: a parabola that departs by d
    from a line over the whole range has beta = 4 d."""
    share = light.contrast / plane.quantisation / sensor.saturation
    return max(4 * sensor.bend_uncertainty * share, MIN_BEND_UNCERTAINTY)


def _block_pixels(registration: Registration, shape: tuple[int, ...]) -> tuple[Indices, Indices]:
    """Pixels (x, y) inside the chart's blocks, away from their borders, and their blocks (column, row)."""
    points = Window.around(registration, shape, float(BLOCK), 0.0).pixels()
    cells = registration.to_pattern(points.astype(np.float64)) + BLOCK
    blocks = np.floor(cells / BLOCK)
    place = cells - BLOCK * blocks
    margin = BLOCK * min(0.3, 2.0 / block_size_px(registration))
    clear = ((place >= margin) & (place <= BLOCK - margin) & (blocks >= 0) & (blocks < BLOCKS)).all(axis=1)
    return points[clear], blocks[clear].astype(np.int64)


@dataclass(frozen=True)
class _Block:
    """Pixels of one block (n, 2), their monomials and samples, the mask of inliers, and the residuals of the block's
    own surface, of degree two because stray light from the neighbours enters, where there are enough samples."""

    pixels: Indices
    design: Array
    value: Array
    inliers: Mask
    residuals: Array


def _block_reader(
    samples: Array32,
    registration: Registration,
    points: Indices,
    block: Indices,
    quantisation: float,
) -> Callable[[tuple[int, int]], _Block]:
    """Function from a column and row to the block there."""
    number = block[:, 0] + BLOCKS * block[:, 1]
    order = np.argsort(number, kind="stable")
    starts = np.searchsorted(number[order], np.arange(BLOCKS * BLOCKS + 1)).tolist()

    @cache
    def block_at(place: tuple[int, int]) -> _Block:
        n = place[0] + BLOCKS * place[1]
        pixels = points[order[starts[n] : starts[n + 1]]]
        value = samples[pixels[:, 1], pixels[:, 0]].astype(np.float64)
        design = quadratic(*((pixels - registration.centre) / registration.radius).T)
        return _Block(pixels, design, value, *_find_inliers(design, value, OUTLIER_SIGMAS * quantisation))

    return block_at


def _find_inliers(design: Array, value: Array, least: float) -> tuple[Mask, Array]:
    """Mask (n,) of a block's samples free of specks, scratches and shadows, if most are; and the residuals of the
    surface through these."""
    if len(value) <= MIN_SAMPLES:
        return np.ones(len(value), dtype=bool), _without_surface(design, value)
    kept, residuals = np.zeros(len(value), dtype=bool), value - quantile(value, 0.5)
    for _ in range(4):
        away = np.abs(residuals)
        last, kept = kept, np.asarray(away <= max(OUTLIER_SIGMAS * 1.4826 * quantile(away, 0.5), least))
        if np.count_nonzero(kept) <= MIN_SAMPLES or np.array_equal(kept, last):
            break
        residuals = value - design @ np.linalg.lstsq(design[kept], value[kept], rcond=None)[0]
    return kept, residuals


def _terms(count: int) -> int:
    """Number of monomials of the surface through so many samples of a block."""
    return 6 if count > MIN_SAMPLES else 3 if 2 * count > MIN_SAMPLES else 1


def _without_surface(design: Array, value: Array) -> Array:
    """Residuals (n,) of a block's samples from their surface."""
    used = design[:, : _terms(len(value))]
    return np.asarray(value - used @ np.linalg.lstsq(used, value, rcond=None)[0]) if len(value) else value


def _fit_blocks(
    block_at: Callable[[tuple[int, int]], _Block], places: tuple[tuple[int, int], ...]
) -> tuple[Array, float, float]:
    """Quadratic through the pixels of the given blocks, their variance about a quadratic per block, and the correlation
    of neighbours."""
    blocks = [block_at(place) for place in places]
    square, freedom, neighbours = 0.0, 0, np.zeros(2)
    for block in blocks:
        residual = block.residuals[block.inliers]
        if len(residual) > 1:
            square += float(residual @ residual)
            freedom += len(residual) - _terms(len(residual))
            # sums of products of residuals (n,) at pixels (n, 2) with their right and lower neighbours
            points = block.pixels[block.inliers]
            corner = points.min(axis=0)
            grid = np.zeros(points.max(axis=0) - corner + 1)
            grid[tuple((points - corner).T)] = residual
            neighbour_correlation = float(np.sum(grid[1:] * grid[:-1])), float(np.sum(grid[:, 1:] * grid[:, :-1]))
            neighbours += neighbour_correlation
    coefficients = _robust_fit(
        [block.design[block.inliers] for block in blocks], [block.value[block.inliers] for block in blocks]
    )
    correlation = float(max(neighbours, key=abs)) / square if square > 0 else 0.0
    return coefficients, square / max(freedom, 1), correlation


def _robust_fit(designs: list[Array], values: list[Array]) -> Array:
    """Least squares over all blocks except the hidden or shaded ones, whose mean is an outlier of the fit."""
    used = [i for i, value in enumerate(values) if len(value)]
    design = np.array([designs[i].mean(axis=0) for i in used])
    level = np.array([values[i].mean() for i in used])
    weight = np.ones(len(used))
    for _ in range(10):
        fit = np.linalg.lstsq(design * weight[:, None], level * weight, rcond=None)[0]
        residual = np.abs(level - design @ fit)
        weight = 1 / np.sqrt(1 + (residual / (2 * quantile(residual, 0.5) + 1e-4)) ** 4)
    kept = [used[i] for i in np.flatnonzero(weight > 0.2)]
    return np.asarray(
        np.linalg.lstsq(np.vstack([designs[i] for i in kept]), np.concatenate([values[i] for i in kept]), rcond=None)[0]
    )
