"""Charts too large for an estimate of the PSF: measured in a reduced picture, then refined bin by bin in all pixels.

A chart that fills a frame of many megapixels has cells of ten pixels and more. Averaged over squares of pixels it is
small enough for the joint estimate of PSF and map, which locates its bins to a tenth of a pixel. Then each bin is
rendered, blurred, and fitted to the photograph: least squares in brightness, contrast, blur and shift

    y = a + b u + c lap u - b (d_x u_x + d_y u_y)

gives the remaining shift d, with its covariance from the residuals of the bin's pixels.
"""

from dataclasses import dataclass, replace
from math import ceil

import cv2
import numpy as np

from procedures.geometry.chart_bins.bin_kernels import COLUMNS, MARGIN, RenderModel, fit_bins
from procedures.numerics.arrays import Array, Array32, Indices, Mask
from procedures.outcome import Refused
from procedures.pattern import BLOCK, CELLS, Chart
from procedures.pattern_psf.correspondences import BINS, Correspondences
from procedures.pattern_psf.rasterise import whole_chart
from procedures.pattern_psf.registration import Registration

BLUR_PX = 0.8  # initial standard deviation of the blur; the fit corrects it
BLUR_ITERATIONS, BLUR_TOLERANCE_PX = 5, 0.005
"""Corrections of the blur, which is nonlinear over the range from sharp to blurred pictures, and the least of them."""
LEAST_BLUR_PX, MOST_BLUR_PX = 0.2, 4.0
FINE, FEWEST_FINE = 6.0, 3
"""Places rendered along a cell, approximately, and along a pixel at least: sharp pictures vary within a pixel."""
LEAST_DETERMINANT = 1e-12  # determinant, for columns of norm 1, below which a bin is not determined
MAX_ITERATIONS = 3
TOLERANCE_PX = 0.005  # shift at which a bin has converged: each iteration reduces it about tenfold
LOST_PX = 2.0  # a bin displaced by more than this from its position in the reduced picture is a mismatch
OUTLIER_RATIO = 5.0
"""Uncertainty relative to the median at which a bin is excluded: hidden, at the edge, in a reflection."""
FEWEST_BINS = 100  # fewer bins show too little of a chart


def reduced(samples: Array32, factor: int) -> Array32:
    """Means over squares of `factor` x `factor` samples; incomplete squares are dropped.

    Pixel i has its centre at factor i + (factor - 1) / 2.
    """
    rows, columns = (size // factor for size in samples.shape)
    whole = samples[: rows * factor, : columns * factor]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)


def enlarged(bins: Correspondences, factor: int) -> Correspondences:
    """The correspondences of a reduced picture in pixels of the original."""
    return Correspondences(bins.index, factor * bins.points + (factor - 1) / 2, factor**2 * bins.covariance)


@dataclass(frozen=True, eq=False)
class _Scene:
    """Rendering of the bins, the map from pixels of the reduced picture to cells, and initial positions."""

    look: RenderModel
    registration: Registration
    start: Correspondences

    def blurred(self, blur_px: float) -> "_Scene":
        """The scene rendered with a blur of that standard deviation."""
        sigma = self.look.n * blur_px
        weights = cv2.getGaussianKernel(round(8 * sigma + 1) | 1, sigma, cv2.CV_64F).ravel()
        return replace(self, look=self.look._replace(blur=np.asarray(weights, dtype=np.float64)))


def refine_bins(
    samples: Array32, chart: Chart, registration: Registration, bins: Correspondences, factor: int
) -> Correspondences:
    """Positions of the bins from all pixels.

    Raises Refused if hardly any bin is near its position in the reduced plane.

    samples : (rows, columns) float32, the plane
    registration : Registration, from pixels of the plane reduced by `factor` to cells
    bins : Correspondences, of the reduced plane
    """
    start = enlarged(bins, factor)
    # the bins of a photograph, without blur
    cells = np.asarray(whole_chart(chart), dtype=np.float64)
    per_pixel = float(np.sqrt(abs(np.linalg.det(registration.jacobian())))) / factor
    n = max(2 * ceil(FINE * per_pixel / 2) - 1, FEWEST_FINE)
    r, none = registration, np.zeros(0)
    look = RenderModel(
        samples, cells, r.H, r.centre, float(r.radius), r.displacement, factor, float(BLOCK), CELLS / BINS / 2, n,
        per_pixel / n, none,
    )  # fmt: skip
    scene = _Scene(look, registration, start)
    points, covariance = _placed(scene.blurred(_usual_blur(scene)))
    spread = np.sqrt(np.einsum("naa->n", covariance))
    fitted = np.isfinite(spread)
    good = fitted & (spread < OUTLIER_RATIO * np.median(spread[fitted])) if fitted.any() else fitted
    if good.sum() < FEWEST_BINS:
        raise Refused(
            f"{FEWEST_BINS} of the {BINS * BINS} parts of the chart must be clearly visible; {int(good.sum())} are",
            "show the whole chart, sharp, evenly lit and free of reflections",
        )
    return Correspondences(start.index[good], points[good], covariance[good])


def _usual_blur(scene: _Scene) -> float:
    """Median standard deviation of the blur, in pixels, over a subset of the bins."""
    count, blur = len(scene.start.index), BLUR_PX
    some = np.arange(0, count, max(1, count // 24))
    for _ in range(BLUR_ITERATIONS):
        fit = _fit(scene.blurred(blur), scene.start.points, some)
        square = blur**2 + (float(np.median(fit.widening[fit.good])) if fit.good.any() else 0.0)
        last, blur = blur, float(np.clip(np.sqrt(max(square, 0.0)), LEAST_BLUR_PX, MOST_BLUR_PX))
        if abs(blur - last) < BLUR_TOLERANCE_PX:
            break
    return blur


def _placed(scene: _Scene) -> tuple[Array, Array]:
    """Positions of the bins (n, 2), and their covariances; infinite where a fit fails."""
    first = scene.start.points
    points, covariance, left = first.copy(), np.full((len(first), 2, 2), np.inf), np.arange(len(first))
    for _ in range(MAX_ITERATIONS):
        fit = _fit(scene, points, left)
        moved = points[left] + fit.shift
        good = fit.good & (np.linalg.norm(moved - first[left], axis=1) <= LOST_PX)
        points[left[good]], covariance[left[good]], covariance[left[~good]] = moved[good], fit.covariance[good], np.inf
        left = left[good & (np.abs(fit.shift).max(axis=1) >= TOLERANCE_PX)]
    return points, covariance


@dataclass(frozen=True, eq=False)
class _Fit:
    """Fits of m bins: shifts (x, y) in pixels with covariances, correction of the squared blur, and success."""

    shift: Array
    covariance: Array
    widening: Array
    good: Mask


def _fit(scene: _Scene, points: Array, chosen: Indices) -> _Fit:
    """Fit the chosen bins at `points` (of all bins, in pixels) to the photograph."""
    look, centres, points = scene.look, scene.start.cells[chosen], points[chosen]
    low, high = _reach(scene, points)
    inside = ((low >= 0) & (high < np.array(look.samples.shape[::-1]))).all(axis=1)
    sums = np.zeros((len(chosen), COLUMNS + 1, COLUMNS + 1))
    fitted = sums[inside]
    fit_bins(look, centres[inside], points[inside], low[inside], high[inside], fitted)
    sums[inside] = fitted
    # least squares from the products (m, 6, 6) of columns and samples
    AA, Av, vv, count = sums[:, :-1, :-1], sums[:, :-1, -1], sums[:, -1, -1], sums[:, 0, 0]
    norm = np.sqrt(np.einsum("naa->na", AA))
    norm[norm == 0] = 1.0
    determined = np.linalg.det(AA / norm[:, :, None] / norm[:, None]) > LEAST_DETERMINANT
    inverse = np.linalg.inv(np.where(determined[:, None, None], AA, np.eye(COLUMNS)))
    solution = np.einsum("nab,nb->na", inverse, Av)
    variance = (vv - np.einsum("na,na->n", solution, Av)) / np.maximum(count - COLUMNS, 1)
    contrast = solution[:, 1]
    good = determined & (contrast > 0)
    contrast = np.where(good, contrast, 1.0)
    covariance = inverse[:, 3:, 3:] * (variance / contrast**2)[:, None, None]
    return _Fit(solution[:, 3:] / contrast[:, None], covariance, 2 * solution[:, 2] / contrast, good)


def _reach(scene: _Scene, points: Array) -> tuple[Indices, Indices]:
    """First and last pixel (x, y) to render for bins at points (m, 2)."""
    half, middle = scene.look.half, (scene.look.factor - 1) / 2
    cells = scene.registration.to_pattern((points - middle) / scene.look.factor)
    corners = cells[:, None] + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    edges = scene.look.factor * scene.registration.to_sensor(corners.reshape(-1, 2)).reshape(-1, 4, 2) + middle
    low, high = np.floor(edges.min(axis=1)) - MARGIN, np.ceil(edges.max(axis=1)) + MARGIN
    return low.astype(np.int64), high.astype(np.int64)
