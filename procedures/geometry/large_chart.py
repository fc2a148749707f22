"""Charts larger than the PSF can be estimated from: measured small first, then bin by bin in all their pixels.

A chart that fills a frame of many megapixels has cells of ten pixels and more. Averaged over squares of pixels it is
small enough for the joint estimate of PSF and map, whose bins are then right to a tenth of a pixel. There each bin is
drawn as it should be seen, blurred, and laid onto the photograph: least squares in brightness, contrast, blur and shift

    y = a + b u + c lap u - b (d_x u_x + d_y u_y)

gives the shift d that is left, with its covariance from what the bin's pixels keep of noise and of all else.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
import numpy.typing as npt

from procedures.outcome import Refused
from procedures.pattern import BLOCK, CELLS, Chart
from procedures.pattern_psf.correspondences import BINS, Correspondences
from procedures.pattern_psf.rasterise import whole_chart
from procedures.pattern_psf.registration import Registration

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

BLUR_PX = 0.8
"""Standard deviation of the blur with which a bin is first drawn; the fit corrects it."""
LEAST_BLUR_PX, MOST_BLUR_PX = 0.4, 4.0
MARGIN = 6
"""Pixels drawn around a bin: what blurs into it."""
FINE = 6.0
"""Places along a cell at which a bin is drawn, about."""
SWEEPS = 3
STILL_PX = 0.002
LOST_PX = 2.0
"""A bin that ends farther from where the small picture had it was drawn onto something else."""
POOR = 5.0
"""Uncertainty over the usual one from which a bin is left out: hidden, at the rim, in a reflection."""
FEWEST = 100
"""Bins under which too little of a chart is seen."""


def reduced(samples: Array32, factor: int) -> Array32:
    """Means over squares of `factor` x `factor` samples; what is left at the right and lower rim is dropped.

    Pixel i of it has its centre at factor i + (factor - 1) / 2.
    """
    rows, columns = (size // factor * factor for size in samples.shape)
    squares = samples[:rows, :columns].reshape(rows // factor, factor, columns // factor, factor)
    return np.asarray(squares.mean(axis=(1, 3), dtype=np.float32))


def enlarged(seen: Correspondences, factor: int) -> Correspondences:
    """The same points in the pixels that were averaged."""
    return Correspondences(seen.index, factor * seen.points + (factor - 1) / 2, factor**2 * seen.covariance)


@dataclass(frozen=True, eq=False)
class _Scene:
    """A photograph, the chart's integral, and the map from the photograph's pixels to cells."""

    samples: Array32
    integral: Array
    registration: Registration
    factor: int

    def cells(self, pixels: Array) -> Array:
        """Cells (n, 2) at pixels (n, 2)."""
        return self.registration.to_pattern((pixels - (self.factor - 1) / 2) / self.factor)


def refine_bins(
    samples: Array32, chart: Chart, registration: Registration, seen: Correspondences, factor: int
) -> Correspondences:
    """Where the bins are seen, from all pixels.

    Parameters
    ----------
    samples : (rows, columns) float32
        The plane.
    chart : Chart
    registration : Registration
        From the pixels of the plane reduced by `factor` to cells.
    seen : Correspondences
        Of the reduced plane.
    factor : int

    Raises
    ------
    Refused
        If hardly any bin is where the reduced plane shows it.
    """
    integral = np.pad(whole_chart(chart), ((1, 0), (1, 0))).cumsum(0, dtype=np.float64).cumsum(1)
    scene = _Scene(samples, integral, registration, factor)
    start = enlarged(seen, factor)
    blur = _usual_blur(scene, start)
    points, covariance = start.points.copy(), np.full((len(start.index), 2, 2), np.inf)
    for i, centre in enumerate(start.cells):
        placed = _place(scene, centre, start.points[i], blur)
        if placed is not None:
            points[i], covariance[i] = placed
    spread = np.sqrt(np.einsum("naa->n", covariance))
    found = np.isfinite(spread)
    good = found & (spread < POOR * np.median(spread[found])) if found.any() else found
    if good.sum() < FEWEST:
        raise Refused(
            f"of the chart's {BINS * BINS} parts {FEWEST} must be seen clearly; {int(good.sum())} are",
            "show the whole chart, sharp, evenly lit and free of reflections",
        )
    return Correspondences(start.index[good], points[good], covariance[good])


def _usual_blur(scene: _Scene, start: Correspondences) -> float:
    """The standard deviation, in pixels, that most of some bins ask for."""
    found = []
    for i in range(0, len(start.index), max(1, len(start.index) // 24)):
        fit = _fit(scene, start.cells[i], start.points[i], BLUR_PX)
        if fit is not None:
            found.append(fit.blur_square)
    square = float(np.median(found)) if found else BLUR_PX**2
    return float(np.clip(np.sqrt(max(square, 0.0)), LEAST_BLUR_PX, MOST_BLUR_PX))


def _place(scene: _Scene, centre: Array, point: Array, blur: float) -> tuple[Array, Array] | None:
    """Where a bin is seen and its covariance; None where it cannot be laid onto the photograph."""
    at, covariance = point, np.zeros((2, 2))
    for _ in range(SWEEPS):
        fit = _fit(scene, centre, at, blur)
        if fit is None or np.linalg.norm(at + fit.shift - point) > LOST_PX:
            return None
        at, covariance = at + fit.shift, fit.covariance
        if np.abs(fit.shift).max() < STILL_PX:
            break
    return at, covariance


@dataclass(frozen=True, eq=False)
class _Fit:
    """Of one bin: the shift (x, y) it is off by in pixels, its covariance, and the blur's square that fits."""

    shift: Array
    covariance: Array
    blur_square: float


def _fit(scene: _Scene, centre: Array, point: Array, blur: float) -> _Fit | None:
    """A bin drawn around a point of the photograph and laid onto it."""
    half = CELLS / BINS / 2
    to_bin = scene.cells(point[None])[0] - centre  # the map has the bin's centre a little beside the point
    corners = centre + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    rim = scene.factor * scene.registration.to_sensor(corners + to_bin) + (scene.factor - 1) / 2
    low, high = np.floor(rim.min(axis=0)).astype(int) - MARGIN, np.ceil(rim.max(axis=0)).astype(int) + MARGIN
    if (low < 0).any() or (high >= np.array(scene.samples.shape[::-1])).any():
        return None
    per_pixel = float(np.sqrt(abs(np.linalg.det(scene.registration.jacobian())))) / scene.factor
    n = 2 * ceil(FINE * per_pixel / 2) - 1
    x, y = np.meshgrid(_fine(low[0], high[0], n), _fine(low[1], high[1], n))
    cells = scene.cells(np.column_stack([x.ravel(), y.ravel()])) - to_bin
    drawn = _box_mean(scene.integral, cells + BLOCK, per_pixel / n).reshape(x.shape)
    u = cv2.GaussianBlur(drawn, (0, 0), n * blur, borderType=cv2.BORDER_REFLECT)
    u_y, u_x = (n * slope for slope in np.gradient(u))
    curved = n * (np.gradient(u_x, axis=1) + np.gradient(u_y, axis=0))
    own = (np.abs(cells - centre) < half).all(axis=1).reshape(x.shape)[n // 2 :: n, n // 2 :: n]
    A = np.stack([one[n // 2 :: n, n // 2 :: n] for one in (np.ones_like(u), u, curved, -u_x, -u_y)], axis=-1)[own]
    values = scene.samples[low[1] : high[1] + 1, low[0] : high[0] + 1][own].astype(np.float64)
    AA = A.T @ A
    try:
        inverse = np.linalg.inv(AA)
    except np.linalg.LinAlgError:
        return None
    found = inverse @ (A.T @ values)
    contrast, variance = found[1], float(np.mean((values - A @ found) ** 2)) * len(values) / (len(values) - 5)
    if contrast <= 0:
        return None
    return _Fit(found[3:] / contrast, inverse[3:, 3:] * variance / contrast**2, blur**2 + 2 * found[2] / contrast)


def _fine(low: int, high: int, n: int) -> Array:
    """Places `n` to a pixel, n odd, pixels in their middle."""
    return np.arange((high - low + 1) * n) / n + low - (n - 1) / (2 * n)


def _box_mean(integral: Array, places: Array, side: float) -> Array:
    """Means of the chart over squares of a side around places (n, 2), in cells from the chart's corner."""
    low, high = places - side / 2, places + side / 2
    total = _read(integral, high[:, 0], high[:, 1]) - _read(integral, low[:, 0], high[:, 1])
    total += _read(integral, low[:, 0], low[:, 1]) - _read(integral, high[:, 0], low[:, 1])
    return np.asarray(total / side**2)


def _read(table: Array, x: Array, y: Array) -> Array:
    """The integral at (x, y): exact between its lines, as cells are even."""
    rows, columns = table.shape
    x, y = np.clip(x, 0, columns - 1.001), np.clip(y, 0, rows - 1.001)
    j, i = x.astype(np.int64), y.astype(np.int64)
    a, b = x - j, y - i
    return np.asarray(
        (1 - b) * ((1 - a) * table[i, j] + a * table[i, j + 1])
        + b * ((1 - a) * table[i + 1, j] + a * table[i + 1, j + 1])
    )
