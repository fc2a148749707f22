"""Rims of lamps: the part of a pixel that a lamp covers, from the shape of its rim and the pixel's own samples.

A lamp covers a part a of a pixel at its rim, and each of the n samples sees it or not. No other pixel is similar, and
own samples leave a standard deviation of sqrt(a (1 - a) / n): where all miss a bright lamp, the pixel is dark. But the
samples of the pixels around determine the rim, a line or a circle. What they say of the pixel is the prior, a beta
distribution; its own samples make that the posterior, again a beta distribution. Far from the rim the prior is 0.

Not all lamps have such rims. A pixel's own mean is independent of its prior: their mean squared difference, less the
noise of the own means, is the prior's squared error. The prior counts as many samples as that error allows nearby.

A pixel that sees the lamp by a single sample is not raised: pixels that see it once look alike, however much it covers.
"""

from collections.abc import Iterator
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy import ndimage, special

from procedures.numerics.arrays import Array, Indices, Mask
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_noise import mean_variance

REACH = 2  # half size of the neighbourhood that determines a rim, pixels
SIDE = 2 * REACH + 1
CENTRE = SIDE * SIDE // 2
CONTRAST = 10.0  # how many times as bright as the darkest pixel nearby a lamp is
QUIET = 0.01  # largest variance of a lamp's own samples, as a fraction of its squared step in brightness
SHAPE_ERROR = 0.05
"""Largest standard deviation of covered parts from those of lines and circles: at a half covered pixel."""
MISFIT = 30.0  # deviance of 24 pixels above which neither a line nor a circle is a rim's shape
LEAST_HITS = 0.25  # samples seeing the lamp, or not seeing it, below which none does: the rest is noise
LEAST = 0.02  # smallest part, and smallest rest, of a shape that is compared with the parts seen
LEAST_PART = 0.005  # parts expected by the shape below which a pixel is not at the rim
SHOWN = 0.5
"""Values are averaged as x / (SHOWN + x), as the eye and a display do: a possible lamp must not outshine the rest."""
DARK = 0.08
"""Added to x^2 in the weights 1 / (x^2 + DARK) where no own sample sees the lamp: a dark pixel that is raised
errs more, relative to its light, than a lit one that stays dark."""
TRUST_PX, TRUST = 3.0, 2.0
"""Standard deviation of the neighbourhood in which the prior's error is determined, pixels, and a factor on the noise
in that comparison: pixels that all miss a lamp have none."""
FLOOR = 0.01  # added to squared values in relative squared errors
BESIDE = 6  # distance to a lamp up to which a pixel is beside it: half the side of the filter's search
LONE = 0.7
"""Squared relative noise above which a pixel's light is that of a single sample: 1 - 1/n for one, half for two."""
RADII = 1.0, 1.3, 1.7, 2.2, 3.0, 4.0, 6.0, 10.0  # radii of round rims, pixels
TURNS, STEP, SUBPIXELS = 40, 0.1, 4
"""Directions of a rim, distances between rims in pixels, and points along a pixel's side."""
QUANTILES = (np.arange(24) + 0.5) / 24  # quantiles of the posterior over which values are averaged
PIXELS = 256  # pixels whose rims are determined at once


def lamp_rims(film: Film, picture: npt.NDArray[np.floating]) -> tuple[Array, Array]:
    """Values of the pixels at rims of lamps and their standard uncertainties, (rows, columns, 3); NaN elsewhere.

    Pixels beside a lamp that see it by a single sample have a value only.

    None are found in films without histograms, as the numbers of their samples are unknown, and where a lamp has no
    pixel of its own.

    picture : (rows, columns, 3) the filtered one: what is beside the lamps
    """
    values, uncertainty = np.full((2, *film.mean.shape), np.nan)
    if film.histogram.shape[-1] and min(film.count.shape) >= SIDE:
        noise = mean_variance(film).sum(-1) * film.count
        expected = np.full((10, *film.count.shape), np.nan)
        for near in _near_lamps(film.mean.sum(-1)):
            expected[:, *near], values[near] = _expected(film, noise, picture, *near)
        rim = np.isfinite(expected[0])
        values[rim], uncertainty[rim] = _estimates(expected[:, rim], rim)
    return values, uncertainty


def beside_lamps(film: Film) -> Mask:
    """Pixels (rows, columns) beside a lamp: `CONTRAST` times as bright, and of samples that are nearly alike."""
    brightness, noise = film.mean.sum(-1), mean_variance(film).sum(-1) * film.count
    lamps = np.where(noise < QUIET * brightness**2, brightness, 0)
    return np.asarray(ndimage.maximum_filter(lamps, 2 * BESIDE + 1) > CONTRAST * np.maximum(brightness, 0))


def _estimates(expected: Array, rim: Mask) -> tuple[Array, Array]:
    """Values and uncertainties (n, 3) of the pixels at a rim (rows, columns), with what `_expected` knows of them."""
    part, variance, n, hits = expected[:4]
    lamp, dark = expected[4:7].T, expected[7:].T
    own, scale = hits / n, ((lamp - dark) ** 2 / ((dark + part[:, None] * (lamp - dark)) ** 2 + FLOOR)).sum(-1)
    errors = np.zeros((2, *rim.shape))
    errors[:, rim] = np.stack([own * (1 - own) / np.maximum(n - 1, 1), (own - part) ** 2]) * scale
    noise, both = ndimage.gaussian_filter(errors, (0, TRUST_PX, TRUST_PX))[:, rim]
    trust = np.minimum(TRUST * noise / np.maximum(both, 1e-12), 1)
    most = n * trust / np.maximum(1 - trust, 1e-9)
    a, b = _beta(part, variance + 4 * SHAPE_ERROR**2 * part * (1 - part), most)
    covered = special.betaincinv((a + hits)[:, None], (b + n - hits)[:, None], QUANTILES)[..., None]
    possible = dark[:, None] + covered * (lamp - dark)[:, None]
    shown = np.mean(possible / (SHOWN + np.maximum(possible, 0)), axis=1)
    weight = 1 / (possible**2 + DARK)
    dim = np.mean(possible * weight, axis=1) / np.mean(weight, axis=1)
    values = np.where(hits[:, None] < 0.5, dim, SHOWN * shown / (1 - shown))
    return values, np.sqrt(np.mean((possible - values[:, None]) ** 2, axis=1))


def _near_lamps(brightness: Array) -> Iterator[tuple[Indices, Indices]]:
    """Rows and columns of the pixels near something much brighter, some at a time."""
    most, least = ndimage.maximum_filter(brightness, SIDE), ndimage.minimum_filter(brightness, SIDE)
    near = (most > CONTRAST * np.maximum(least, 0)) & (brightness < most)
    rows, columns = np.nonzero(near[REACH:-REACH, REACH:-REACH])
    for i in range(0, len(rows), PIXELS):
        yield rows[i : i + PIXELS] + REACH, columns[i : i + PIXELS] + REACH


def _expected(
    film: Film, noise: Array, picture: npt.NDArray[np.floating], rows: Indices, columns: Indices
) -> tuple[Array, Array]:
    """Knowledge from the pixels around, (10, n): part covered, its variance, own samples, hits, lamp and dark values.

    NaN where not at a rim; and the values of pixels that see a lamp once, (n, 3).

    noise : (rows, columns) variance of samples.
    """
    offsets = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1].reshape(2, -1)
    around = rows[:, None] + offsets[0], columns[:, None] + offsets[1]
    means, filtered, n = film.mean[around], picture[around].astype(np.float64), film.count[around].astype(np.float64)
    each, brightest, darkest = np.arange(len(rows)), means.sum(-1).argmax(1), filtered.sum(-1).argmin(1)
    lamp, dark = means[each, brightest], filtered[each, darkest]
    size = np.maximum(((lamp - dark) ** 2).sum(-1), 1e-30)
    part = ((means - dark[:, None]) * (lamp - dark)[:, None]).sum(-1) / size[:, None]
    part = np.where(part * n < LEAST_HITS, 0, np.where((1 - part) * n < LEAST_HITS, 1, part))
    shape, variance, misfit = _shapes(part, n)
    quiet = noise[around][each, brightest] < QUIET * size
    rim = quiet & (misfit < MISFIT) & (shape > LEAST_PART)
    own, light = n[:, CENTRE], means[:, CENTRE]
    hits = part[:, CENTRE] * own
    alone = quiet & ((noise[rows, columns] / own > LONE * (light**2).sum(-1)) | (np.abs(hits - 1) < 0.5))
    known = np.vstack([shape, variance, own, hits, lamp.T, dark.T])
    return np.where(rim, known, np.nan), np.where(alone[:, None], np.minimum(filtered[:, CENTRE], light), np.nan)


def _shapes(part: Array, n: Array) -> tuple[Array, Array, Array]:
    """Part of the central pixels expected from those around, its variance, and the deviance of the best shape.

    part, n : (pixels, SIDE^2) the parts covered by the samples of each pixel, and their number.
    """
    shapes = _parts_of_shapes()
    lit, unlit = np.log(np.clip(shapes, LEAST, 1 - LEAST)), np.log(1 - np.clip(shapes, LEAST, 1 - LEAST))
    n = n / (1 + 4 * n * SHAPE_ERROR**2) * (np.arange(SIDE**2) != CENTRE)
    likelihood = (part * n) @ lit.T + ((1 - part) * n) @ unlit.T
    share = np.clip(part, LEAST, 1 - LEAST)
    most = (n * (part * np.log(share) + (1 - part) * np.log(1 - share))).sum(1)
    best = likelihood.max(1)
    weights = np.exp(likelihood - best[:, None])
    weights /= weights.sum(1, keepdims=True)
    mean = weights @ shapes[:, CENTRE]
    return mean, np.maximum(weights @ shapes[:, CENTRE] ** 2 - mean**2, 0), 2 * (most - best)


@cache
def _parts_of_shapes() -> Array:
    """Parts of the pixels of a neighbourhood that lines, discs and what is around discs cover, (shapes, SIDE^2).

    Directions of an eighth of a turn suffice: the others are reflections of these. A subpixel is covered by the share
    that a rim across it at its distance leaves.
    """
    grid = (np.arange(SIDE * SUBPIXELS) + 0.5) / SUBPIXELS - SIDE / 2
    distances = np.arange(-SIDE / 2, SIDE / 2 + STEP, STEP)[:, None, None]
    shapes = []
    for turn in np.arange(TURNS // 8 + 1) * 2 * np.pi / TURNS:
        along = np.cos(turn) * grid + np.sin(turn) * grid[:, None] - distances
        across = np.cos(turn) * grid[:, None] - np.sin(turn) * grid
        rims = [along]
        for radius in RADII:
            rims += [np.hypot(along + radius, across) - radius, radius - np.hypot(along - radius, across)]
        shares = np.clip(0.5 - SUBPIXELS * np.concatenate(rims), 0, 1)
        shapes.append(shares.reshape(-1, SIDE, SUBPIXELS, SIDE, SUBPIXELS).mean((2, 4)))
    parts = np.concatenate(shapes)
    parts = np.concatenate([parts, parts[:, ::-1]])
    parts = np.concatenate([parts, parts[:, :, ::-1]])
    parts = np.concatenate([parts, parts.transpose(0, 2, 1)])
    return np.unique(parts.reshape(len(parts), -1).round(4), axis=0)


def _beta(mean: Array, variance: Array, most_samples: Array) -> tuple[Array, Array]:
    """Parameters of the beta distributions with these means and variances that count so many samples at most."""
    mean = np.clip(mean, 1e-6, 1 - 1e-6)
    most = mean * (1 - mean)
    total = np.minimum(most / np.clip(variance, 1e-9, 0.9 * most) - 1, np.maximum(most_samples, 1e-6))
    return mean * total, (1 - mean) * total
