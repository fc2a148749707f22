"""First-order regression: around each pixel the picture is fitted linearly in position and features of the surfaces.

Weights are those of NL-means between the film's patches, less what noise explains (Rousselle, Knaus, Zwicker 2012).
Each fit estimates every pixel of its window, and a pixel is the weighted mean of its estimates (Bitterli and others,
Nonlinearly Weighted First-order Regression for Denoising Monte Carlo Renderings, 2016). Unlike there, the same samples
give weights and values: halves of a half are too noisy.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy import ndimage

from procedures.numerics.arrays import Array, Array32, Indices
from procedures.numerics.compiled import compiled
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.multiscale import allowed_variance

REACH, PATCH = 7, 1  # half sizes of the window and of the compared patches, pixels
DECAY = 0.6  # difference, in standard deviations of the noise, at which the weight has fallen to exp(-1)
LEAST_WEIGHT = 1e-3  # weight below which a pixel is not used
RIDGE = 1e-4  # variance added to that of each feature in its window: a feature that is constant there has no slope
BAND_ROWS = 32  # rows fitted at once
NO_NOISE = 1e-10  # variance added to differences: two pixels without noise may be equal


def regress(film: Film, features: Array, *, threads: int = 1) -> Array:
    """The film's picture, (rows, columns, 3), each pixel from linear fits over the windows that it is in.

    features : (rows, columns, n) float64, in units of the differences over which light changes linearly; none is needed
    threads : int, bands fitted at once; the result does not depend on it
    """
    rows, columns = film.count.shape
    position = np.moveaxis(np.mgrid[:rows, :columns], 0, -1) / REACH
    regressors = np.ascontiguousarray(np.concatenate([position, features], axis=-1))
    offsets = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1].reshape(2, -1).T.copy()
    around = REACH + PATCH
    rim = ((around, around), (around, around), (0, 0))
    mean, variance = (np.pad(array, rim, "symmetric") for array in (film.mean, allowed_variance(film)))
    total = np.zeros((rows + 2 * REACH, columns, 4))

    def fit_rows(top: int) -> Array:
        end = min(rows, top + BAND_ROWS)
        weights = _weights(mean[top : end + 2 * around], variance[top : end + 2 * around], offsets)
        return _fit(film.mean, regressors, weights, offsets, top)

    tops = range(0, rows, BAND_ROWS)
    with ThreadPoolExecutor(threads) as pool:
        for top, band in zip(tops, pool.map(fit_rows, tops), strict=True):
            total[top : top + len(band)] += band
    inside = total[REACH:-REACH]
    return np.asarray(inside[..., :3] / inside[..., 3:])


def _weights(mean: Array, variance: Array, offsets: Indices) -> Array32:
    """Weights (offsets, rows, columns) of the pixels around those of a band, which is padded by window and patch."""
    rows, columns = (size - 2 * REACH for size in mean.shape[:2])
    here = np.s_[REACH : REACH + rows, REACH : REACH + columns]
    weights = np.empty((len(offsets), rows - 2 * PATCH, columns - 2 * PATCH), np.float32)
    for i, (dy, dx) in enumerate(offsets):
        there = np.s_[REACH + dy : REACH + dy + rows, REACH + dx : REACH + dx + columns]
        explained = variance[here] + np.minimum(variance[here], variance[there])
        excess = (mean[here] - mean[there]) ** 2 - explained
        scale = DECAY**2 * (variance[here] + variance[there]) + NO_NOISE
        distance = ndimage.uniform_filter((excess / scale).mean(-1), 2 * PATCH + 1)[PATCH:-PATCH, PATCH:-PATCH]
        weights[i] = np.exp(-np.maximum(distance, 0))
    return weights


@compiled
def _fit(
    picture: Array, regressors: Array, weights: Array32, offsets: Indices, top: int
) -> Array:  # fmt: skip
    """Sums of the weighted estimates and of the weights, (rows + 2 REACH, columns, 4), by the fits around a band.

    Row 0 of the weights is row `top` of the picture.
    """
    rows, columns, n = regressors.shape
    height, m = weights.shape[1], n + 1
    total = np.zeros((height + 2 * REACH, columns, 4))
    matrix, sides, x = np.empty((m, m)), np.empty((m, 3)), np.ones(m)
    for r in range(height):
        for c in range(columns):
            own = regressors[top + r, c]
            matrix[:] = 0.0
            sides[:] = 0.0
            for j in range(len(offsets)):
                y, z, w = top + r + offsets[j, 0], c + offsets[j, 1], weights[j, r, c]
                if w < LEAST_WEIGHT or y < 0 or y >= rows or z < 0 or z >= columns:
                    continue
                for i in range(n):
                    x[i + 1] = regressors[y, z, i] - own[i]
                for i in range(m):
                    for k in range(m):
                        matrix[i, k] += w * x[i] * x[k]
                    for b in range(3):
                        sides[i, b] += w * x[i] * picture[y, z, b]
            for i in range(1, m):
                matrix[i, i] += RIDGE * matrix[0, 0]
            slopes = np.linalg.solve(matrix, sides)
            for j in range(len(offsets)):
                y, z, w = top + r + offsets[j, 0], c + offsets[j, 1], weights[j, r, c]
                if w < LEAST_WEIGHT or y < 0 or y >= rows or z < 0 or z >= columns:
                    continue
                for b in range(3):
                    value = slopes[0, b]
                    for i in range(n):
                        value += slopes[i + 1, b] * (regressors[y, z, i] - own[i])
                    total[r + offsets[j, 0] + REACH, z, b] += w * value
                total[r + offsets[j, 0] + REACH, z, 3] += w
    return total
