"""Inner loops of ray histogram fusion: one band of rows, one chi-square map per offset, each pair once.

A *candidate* is a patch to compare with the patch of a pixel: a frame and an offset (rows, columns). Candidate 0 is the
patch itself; then come the `half` forward offsets of the search block in the pixel's own frame, their opposites in the
same order, and the whole search blocks in the other frames.

Arrays are copied and combined by loops: Numba makes larger code of array expressions, and cannot cache it.
"""

from typing import NamedTuple

import numpy as np

from procedures.numerics.arrays import Array32, Indices
from procedures.numerics.compiled import vectorised

FAR = np.float32(1e30)  # ratio of a pair that cannot be compared: outside the picture, or without a valid bin
RIDGE = np.float32(0.5)
"""Variance of position, pixel^2, added before the trend is fitted: two patches in a row determine no slope across
it."""
FEW = np.float32(15.0)  # number of similar patches below which the threshold is raised
MOST_EASE = np.float32(0.7)  # largest relative increase of the threshold
LEAST_FOR_TREND = np.float32(5.0)
"""Number of similar patches below which no trend is fitted: a plane has three unknowns."""


class Stack(NamedTuple):
    """Frames of one size, the one to filter first: planes (frame, channel, row, column), histograms (frame, row,
    column, bin), counts (frame, row, column) and means (frame, row, column, value): means of the samples' colours
    followed by the variances of these means, or nothing. All float32."""

    planes: Array32
    histograms: Array32
    counts: Array32
    means: Array32


class Rules(NamedTuple):
    """Criteria of similarity and rules of averaging; the fields are those of `filter.FilterParameters`."""

    patch: int
    kappa: float
    softness: float
    at_least: int
    least_count: float
    welch: float
    welch_sigmas: float
    trend: bool
    trust: float
    ease: float
    pixel: float


@vectorised
def means_distance(x: Array32, y: Array32, rules: Rules) -> np.float32:
    """`welch` times the excess of the squared Welch statistics of the colours over the square of `welch_sigmas`."""
    colours = x.size // 2
    distance = np.float32(0.0)
    allowed_square = np.float32(rules.welch_sigmas * rules.welch_sigmas)
    for m in range(colours):
        step = x[m] - y[m]
        distance += max(np.float32(0.0), step * step / (x[colours + m] + y[colours + m]) - allowed_square)
    return np.float32(rules.welch) * distance


@vectorised
def squared_differences(x: Array32, y: Array32) -> tuple[np.float32, np.float32]:
    """Sum of the squared Welch statistics of the three colours, and their number."""
    distance = np.float32(0.0)
    n = x.size // 2
    for m in range(min(3, n)):
        step = x[m] - y[m]
        distance += step * step / (x[n + m] + y[n + m])
    return distance, np.float32(3.0)


@vectorised
def pixel_distances(stack: Stack, candidate: Indices, first: int, rules: Rules, d: Array32, k: Array32) -> None:
    """Chi-square `d` and number of bins `k` between the pixels of frame 0 and those of the candidate.

    Rows `first` to `first + len(d)`. Bins that hold no more than `least_count` samples in total are excluded.
    Equation (4.3), plus a term where means differ significantly. Without histograms the colours' means are compared.
    """
    frame, dr, dc = candidate
    target, other = stack.histograms[0], stack.histograms[frame]
    n0, n1 = stack.counts[0], stack.counts[frame]
    columns = target.shape[1]
    d[:] = 0.0
    k[:] = 0.0
    floor = np.float32(rules.least_count)
    for i in range(d.shape[0]):
        r = first + i
        for c in range(max(0, -dc), min(columns, columns - dc)):
            x = target[r, c]
            y = other[r + dr, c + dc]
            a = np.sqrt(n1[r + dr, c + dc] / n0[r, c])
            b = np.float32(1.0) / a
            distance = np.float32(0.0)
            bins = np.float32(0.0)
            for m in range(x.shape[0]):
                both = x[m] + y[m]
                e = a * x[m] - b * y[m]
                valid = both > floor
                distance += e * e / both if valid else np.float32(0.0)
                bins += np.float32(1.0) if valid else np.float32(0.0)
            if x.shape[0] == 0:
                distance, bins = squared_differences(stack.means[0, r, c], stack.means[frame, r + dr, c + dc])
            d[i, c] = distance + means_distance(stack.means[0, r, c], stack.means[frame, r + dr, c + dc], rules)
            k[i, c] = bins


@vectorised
def patch_ratio(d: Array32, k: Array32, i: int, c: int, patch: int, share: np.float32) -> np.float32:
    """Chi-square per bin over the patch of half size `patch` around row i, column c of the maps. Equation (4.4).

    At least `share` of that of its most different pixel: a mean conceals one bright pixel among dark ones.
    """
    distance = np.float32(0.0)
    bins = np.float32(0.0)
    most = np.float32(0.0)
    for ii in range(max(0, i - patch), min(d.shape[0], i + patch + 1)):
        for cc in range(max(0, c - patch), min(d.shape[1], c + patch + 1)):
            distance += d[ii, cc]
            bins += k[ii, cc]
            most = max(most, d[ii, cc] / max(k[ii, cc], np.float32(1.0)))
    return max(np.float32(distance / bins), share * most) if bins > 0 else FAR


@vectorised
def allowed(p: int, offset: int, size: int, patch: int) -> bool:
    """Whether, along one axis, the patch at p + offset has all the pixels of the patch at p."""
    return min(0, patch - p) <= offset <= max(0, size - 1 - patch - p)


@vectorised
def band_ratios(stack: Stack, candidates: Indices, half: int, rules: Rules, first: int, ratios: Array32) -> None:
    """Chi-square per bin of every candidate for the patches of a band: ratios (candidates, rows, columns).

    The band starts at row `first`. Each pair within the frame is computed once and stored for both patches.
    """
    patch = rules.patch
    rows, columns = stack.counts.shape[1:]
    last = first + ratios.shape[1]
    ratios[:] = FAR
    ratios[0] = 0.0
    for j in range(1, candidates.shape[0]):
        frame, dr, dc = candidates[j]
        both_ways = frame == 0
        if both_ways and j > half:
            continue
        # centres p with p or p + dr in the band; their pixels extend one patch further
        low = max(0, first - (dr if both_ways else 0), -dr)
        high = min(rows, last, rows - dr)
        start = max(0, low - patch, -dr)
        stop = min(rows, high + patch, rows - dr)
        if low >= high:
            continue
        d = np.empty((stop - start, columns), np.float32)
        k = np.empty((stop - start, columns), np.float32)
        pixel_distances(stack, candidates[j], start, rules, d, k)
        for r in range(low, high):
            for c in range(max(0, -dc), min(columns, columns - dc)):
                ratio = patch_ratio(d, k, r - start, c, patch, np.float32(rules.pixel))
                if r >= first and allowed(r, dr, rows, patch) and allowed(c, dc, columns, patch):
                    ratios[j, r - first, c] = ratio
                q, s = r + dr, c + dc
                if both_ways and first <= q < last and allowed(q, -dr, rows, patch) and allowed(s, -dc, columns, patch):
                    ratios[j + half, q - first, s] = ratio


@vectorised
def nearest(ratios: Array32, i: int, c: int, k: int) -> np.float32:
    """The k-th smallest ratio among the candidates of patch (i, c) except itself; 0 if there are fewer than k."""
    best = np.full(k, FAR, np.float32)
    for j in range(1, ratios.shape[0]):
        value = ratios[j, i, c]
        m = k - 1
        if value >= best[m]:
            continue
        while m > 0 and best[m - 1] > value:
            best[m] = best[m - 1]
            m -= 1
        best[m] = value
    return np.float32(best[k - 1]) if best[k - 1] < FAR else np.float32(0.0)


@vectorised
def weigh(ratios: Array32, counts: Array32, rules: Rules) -> None:
    """Turn ratios into weights in [0, 1], in place: 1 well below kappa, 0 well above, a ramp of `softness` between.

    Where few patches are similar, kappa is raised by `ease` per sample in `counts` (rows, columns): with more samples,
    chi-square detects ever smaller differences, along a slope of light before the fitted trend becomes wrong. Where
    fewer than `at_least` other patches are similar, the nearest ones get a weight of one half.
    """
    candidates, rows, columns = ratios.shape
    top = np.float32(rules.kappa * (1 + rules.softness))
    slope = np.float32(1.0 / (rules.kappa * max(2 * rules.softness, 1e-6)))
    similar = np.zeros((rows, columns), np.int64)
    for j in range(1, candidates):
        for i in range(rows):
            for c in range(columns):
                similar[i, c] += ratios[j, i, c] < top
    limits, eased = np.zeros((rows, columns), np.float32), np.empty((rows, columns), np.float32)
    one, none, half = np.float32(1.0), np.float32(0.0), np.float32(0.5)
    for i in range(rows):
        for c in range(columns):
            if similar[i, c] < rules.at_least:
                limits[i, c] = nearest(ratios, i, c, rules.at_least)
            ease = min(MOST_EASE, np.float32(rules.ease) * counts[i, c])
            eased[i, c] = one / (one + ease * max(none, one - similar[i, c] / FEW))
    for j in range(candidates):
        for i in range(rows):
            for c in range(columns):
                ratio = ratios[j, i, c]
                weight = min(one, max(none, (top - ratio * eased[i, c]) * slope))
                ratios[j, i, c] = max(weight, half) if ratio <= limits[i, c] else weight


@vectorised
def fit_patches(stack: Stack, candidates: Indices, rules: Rules, first: int, weights: Array32, fit: Array32) -> Array32:
    """Fit the average of the similar patches of each patch; returns their number, the patch itself included.

    Weights are multiplied by the samples, in place. With mean offset m and covariance C of the similar patches' offsets
    o, the plane fitted to them has at o = 0 the weights w (1 - (o - m)' C^-1 m) / sum w: the average has no first-order
    bias. fit (3, rows, columns) receives 1 + m' C^-1 m and C^-1 m, times the gain of the patch in the aggregation.
    """
    rows, columns = weights.shape[1:]
    similar = np.zeros((rows, columns), np.float32)
    moments = np.zeros((rows, 6, columns), np.float32)
    for j in range(candidates.shape[0]):
        frame, dr, dc = candidates[j]
        y, x = np.float32(dr), np.float32(dc)
        for i in range(max(0, -first - dr), min(rows, stack.counts.shape[1] - first - dr)):
            samples = stack.counts[frame, first + i + dr]
            for c in range(max(0, -dc), min(columns, columns - dc)):
                w = weights[j, i, c]
                similar[i, c] += w
                w *= samples[c + dc]
                weights[j, i, c] = w
                moments[i, 0, c] += w
                moments[i, 1, c] += w * y
                moments[i, 2, c] += w * x
                moments[i, 3, c] += w * y * y
                moments[i, 4, c] += w * y * x
                moments[i, 5, c] += w * x * x
    for i in range(rows):
        for c in range(columns):
            trend = rules.trend and similar[i, c] >= LEAST_FOR_TREND
            fit_patch(moments[i, :, c], trend, similar[i, c], rules.trust, fit[:, i, c])
    return similar


@vectorised
def fit_patch(moments: Array32, trend: bool, similar: float, trust: float, fit: Array32) -> None:
    """One patch of `fit_patches`, from its sum of weights and their first and second moments."""
    total = moments[0]
    my, mx = moments[1] / total, moments[2] / total
    yy = moments[3] / total - my * my + RIDGE
    yx = moments[4] / total - my * mx
    xx = moments[5] / total - mx * mx + RIDGE
    det = yy * xx - yx * yx
    sy = (xx * my - yx * mx) / det if trend else np.float32(0.0)
    sx = (yy * mx - yx * my) / det if trend else np.float32(0.0)
    inflation = np.float32(1.0) + sy * my + sx * mx
    gain = (similar / inflation) ** np.float32(trust) / total
    fit[0] = inflation * gain
    fit[1] = sy * gain
    fit[2] = sx * gain


@vectorised
def aggregate(
    planes: Array32, candidates: Indices, weights: Array32, fit: Array32, top: int, patch: int, fused: Array32
) -> None:
    """Average the patch estimates that cover the pixels of a band: fused (channels, rows, columns).

    Row 0 of the band is row `top` of the picture and row `top - first` of the patches.
    """
    columns = weights.shape[2]
    channels, height = fused.shape[:2]
    total = np.zeros((height, columns), np.float32)
    fused[:] = 0.0
    fitted = np.zeros(weights.shape[1:], np.float32)
    spread = np.zeros(columns, np.float32)
    first = max(0, top - patch)
    for j in range(candidates.shape[0]):
        frame, dr, dc = candidates[j]
        low, high = max(0, -dc), min(columns, columns - dc)
        plane_weights(weights[j], fit, np.float32(dr), np.float32(dc), fitted)
        for y in range(max(0, -top - dr), min(height, planes.shape[2] - top - dr)):
            spread_row(fitted, top + y - first, patch, spread)
            for c in range(low, high):
                total[y, c] += spread[c]
            for b in range(channels):
                source = planes[frame, b, top + y + dr]
                for c in range(low, high):
                    fused[b, y, c] += spread[c] * source[c + dc]
    for b in range(channels):
        for y in range(height):
            for c in range(columns):
                fused[b, y, c] /= total[y, c]


@vectorised
def plane_weights(weights: Array32, fit: Array32, dr: np.float32, dc: np.float32, out: Array32) -> None:
    """Weights of one candidate under the fitted plane: out (rows, columns). `fit` is that of `fit_patches`."""
    for i in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[i, c] = weights[i, c] * (fit[0, i, c] - dr * fit[1, i, c] - dc * fit[2, i, c])


@vectorised
def spread_row(weights: Array32, i: int, patch: int, spread: Array32) -> None:
    """Sum of the weights over the patch around each pixel of row i."""
    rows, columns = weights.shape
    column = np.zeros(columns + 2 * patch, np.float32)
    for ii in range(max(0, i - patch), min(rows, i + patch + 1)):
        for c in range(columns):
            column[c + patch] += weights[ii, c]
    for c in range(columns):
        spread[c] = column[c]
    for t in range(1, 2 * patch + 1):
        for c in range(columns):
            spread[c] += column[c + t]


@vectorised
def fuse_band(
    stack: Stack, candidates: Indices, half: int, rules: Rules, top: int, fused: Array32, similar: Array32
) -> None:  # fmt: skip
    """Filter the rows `top` to `top + len(similar)` of frame 0; fills fused (channels, rows, columns) and similar."""
    rows, columns = stack.counts.shape[1:]
    height = similar.shape[0]
    first = max(0, top - rules.patch)
    last = min(rows, top + height + rules.patch)
    weights = np.empty((candidates.shape[0], last - first, columns), np.float32)
    band_ratios(stack, candidates, half, rules, first, weights)
    weigh(weights, stack.counts[0, first:last], rules)
    fit = np.zeros((3, last - first, columns), np.float32)
    number = fit_patches(stack, candidates, rules, first, weights, fit)
    aggregate(stack.planes, candidates, weights, fit, top, rules.patch, fused)
    for i in range(height):
        for c in range(columns):
            similar[i, c] = number[top - first + i, c]
