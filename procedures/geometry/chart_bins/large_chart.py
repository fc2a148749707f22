"""Charts larger than the PSF can be estimated from: measured small first, then bin by bin in all their pixels.

A chart that fills a frame of many megapixels has cells of ten pixels and more. Averaged over squares of pixels it is
small enough for the joint estimate of PSF and map, whose bins are then right to a tenth of a pixel. There each bin is
drawn as it should be seen, blurred, and laid onto the photograph: least squares in brightness, contrast, blur and shift

    y = a + b u + c lap u - b (d_x u_x + d_y u_y)

gives the shift d that is left, with its covariance from what the bin's pixels keep of noise and of all else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import cv2
import numpy as np
import numpy.typing as npt

from procedures.geometry.chart_bins.bin_kernels import COLUMNS, MARGIN, Look, lay_bins
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
FINE = 6.0
"""Places along a cell at which a bin is drawn, about."""
LEAST_TOLD = 1e-12
"""Determinant, for columns of norm 1, under which a bin's pixels tell nothing."""
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
    """Bins as they are drawn, the map from the reduced picture's pixels to cells, and where the bins begin."""

    look: Look
    registration: Registration
    start: Correspondences

    def blurred(self, blur_px: float) -> _Scene:
        """The same, drawn with a blur of that standard deviation."""
        sigma = self.look.n * blur_px
        weights = cv2.getGaussianKernel(round(8 * sigma + 1) | 1, sigma, cv2.CV_64F).ravel()
        return replace(self, look=self.look._replace(blur=np.asarray(weights, dtype=np.float64)))


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
    start = enlarged(seen, factor)
    scene = _scene(samples, chart, registration, start, factor).blurred(BLUR_PX)
    points, covariance = _placed(scene.blurred(_usual_blur(scene)))
    spread = np.sqrt(np.einsum("naa->n", covariance))
    found = np.isfinite(spread)
    good = found & (spread < POOR * np.median(spread[found])) if found.any() else found
    if good.sum() < FEWEST:
        raise Refused(
            f"of the chart's {BINS * BINS} parts {FEWEST} must be seen clearly; {int(good.sum())} are",
            "show the whole chart, sharp, evenly lit and free of reflections",
        )
    return Correspondences(start.index[good], points[good], covariance[good])


def _scene(samples: Array32, chart: Chart, registration: Registration, start: Correspondences, factor: int) -> _Scene:
    """The bins of a photograph, without their blur."""
    cells = np.asarray(whole_chart(chart), dtype=np.float64)
    per_pixel = float(np.sqrt(abs(np.linalg.det(registration.jacobian())))) / factor
    n = 2 * ceil(FINE * per_pixel / 2) - 1
    r, none = registration, np.zeros(0)
    look = Look(
        samples, cells, r.H, r.centre, float(r.radius), r.displacement, factor, float(BLOCK), CELLS / BINS / 2, n,
        per_pixel / n, none,
    )  # fmt: skip
    return _Scene(look, registration, start)


def _usual_blur(scene: _Scene) -> float:
    """The standard deviation, in pixels, that most of some bins ask for."""
    count = len(scene.start.index)
    fit = _fit(scene, scene.start.points, np.arange(0, count, max(1, count // 24)))
    square = BLUR_PX**2 + (float(np.median(fit.widening[fit.good])) if fit.good.any() else 0.0)
    return float(np.clip(np.sqrt(max(square, 0.0)), LEAST_BLUR_PX, MOST_BLUR_PX))


def _placed(scene: _Scene) -> tuple[Array, Array]:
    """Where the bins are seen (n, 2), and their covariances; infinite where one cannot be laid onto the photograph."""
    first = scene.start.points
    points, covariance, left = first.copy(), np.full((len(first), 2, 2), np.inf), np.arange(len(first))
    for _ in range(SWEEPS):
        fit = _fit(scene, points, left)
        moved = points[left] + fit.shift
        good = fit.good & (np.linalg.norm(moved - first[left], axis=1) <= LOST_PX)
        points[left[good]], covariance[left[good]], covariance[left[~good]] = moved[good], fit.covariance[good], np.inf
        left = left[good & (np.abs(fit.shift).max(axis=1) >= STILL_PX)]
    return points, covariance


@dataclass(frozen=True, eq=False)
class _Fit:
    """Of m bins: the shifts (x, y) they are off by in pixels, with covariances, and what the blur's square lacks.

    `good` are those that could be laid onto the photograph.
    """

    shift: Array
    covariance: Array
    widening: Array
    good: npt.NDArray[np.bool_]


def _fit(scene: _Scene, points: Array, chosen: npt.NDArray[np.int64]) -> _Fit:
    """Some bins, drawn around `points` (of all, in pixels) of the photograph and laid onto it."""
    look, centres, points = scene.look, scene.start.cells[chosen], points[chosen]
    low, high = _reach(scene, points)
    inside = ((low >= 0) & (high < np.array(look.samples.shape[::-1]))).all(axis=1)
    sums = np.zeros((len(chosen), COLUMNS + 1, COLUMNS + 1))
    laid = sums[inside]
    lay_bins(look, centres[inside], points[inside], low[inside], high[inside], laid)
    sums[inside] = laid
    return _solved(sums)


def _reach(scene: _Scene, points: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First and last pixel (x, y) that is drawn of bins (m, 2) each."""
    half, middle = scene.look.half, (scene.look.factor - 1) / 2
    beside = scene.registration.to_pattern((points - middle) / scene.look.factor)
    corners = beside[:, None] + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    rims = scene.look.factor * scene.registration.to_sensor(corners.reshape(-1, 2)).reshape(-1, 4, 2) + middle
    low, high = np.floor(rims.min(axis=1)) - MARGIN, np.ceil(rims.max(axis=1)) + MARGIN
    return low.astype(np.int64), high.astype(np.int64)


def _solved(sums: Array) -> _Fit:
    """Least squares from the products (m, 6, 6) of the bins' columns and samples."""
    AA, Av, vv, count = sums[:, :-1, :-1], sums[:, :-1, -1], sums[:, -1, -1], sums[:, 0, 0]
    norm = np.sqrt(np.einsum("naa->na", AA))
    norm[norm == 0] = 1.0
    told = np.linalg.det(AA / norm[:, :, None] / norm[:, None]) > LEAST_TOLD
    inverse = np.linalg.inv(np.where(told[:, None, None], AA, np.eye(COLUMNS)))
    found = np.einsum("nab,nb->na", inverse, Av)
    variance = (vv - np.einsum("na,na->n", found, Av)) / np.maximum(count - COLUMNS, 1)
    contrast = found[:, 1]
    good = told & (contrast > 0)
    contrast = np.where(good, contrast, 1.0)
    covariance = inverse[:, 3:, 3:] * (variance / contrast**2)[:, None, None]
    return _Fit(found[:, 3:] / contrast[:, None], covariance, 2 * found[:, 2] / contrast, good)
