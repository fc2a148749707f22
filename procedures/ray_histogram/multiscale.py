"""Algorithm 2: noise wider than the search block is removed at coarser scales and the result brought to the finest."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.sparse import csr_array

from procedures.display import summary
from procedures.numerics.arrays import Array, Array32, Indices
from procedures.outcome import BadInput
from procedures.ray_histogram.film import LARGEST, Film
from procedures.ray_histogram.film_noise import mean_variance
from procedures.ray_histogram.filter import FilterParameters, Fused, Samples, fuse_scale
from procedures.ray_histogram.rims import beside_lamps, lamp_rims

SIGMA = 0.55  # target blur in coarse pixels: scale s is blurred by SIGMA sqrt(4^s - 1) fine pixels

FAINT = 1e-3  # smallest variance of a pixel's mean, as a fraction of the average over all pixels
LEAST_VARIANCE = 1e-12  # smallest variance where no pixel is noisy

RANGE_SIDE = 5  # side of the neighbourhood, in pixels, whose noisy values bound the filtered one
AROUND_SIDE = 7  # side of the neighbourhood, in pixels, whose variance bounds the filtered value too
ALIKE, UNLIKE = 1.5, 3.0
"""Variance of the means around a pixel over that of their noise: up to the first all pixels there are alike, from the
second on the pixel's own variance counts alone. Of 49 values the ratio has a standard deviation of 0.2."""
CHANGE_PX, EXPLAINED = 1.5, 2.0
"""Standard deviation of the neighbourhood in which changes beside a lamp are compared with noise, pixels, and the mean
square up to which noise explains them, in variances of the samples' means: without bias it is 1 at most."""


@dataclass(frozen=True)
class FilteredFilm:
    """Result of filtering a film.

    picture : (rows, columns, 3) float32, the filtered picture, linear
    similar : (rows, columns) float32, similar patches per pixel at the finest scale (see `filter.Fused`)
    median_similar : tuple of float, their median at each scale, the finest first
    uncertainty : (rows, columns, 3) float32 or None
        Standard uncertainty of the picture (see `uncertainty`), if requested.
    """

    picture: Array32
    similar: Array32
    median_similar: tuple[float, ...]
    uncertainty: Array32 | None = None

    __repr__ = summary


def filter_film(
    film: Film,
    parameters: FilterParameters | None = None,
    *,
    neighbours: Sequence[Film] = (),
    guides: Array32 | None = None,
    threads: int = 1,
) -> FilteredFilm:
    """Filter a film by Algorithm 2.

    film : Film, checked here; at least one sample in each pixel
    parameters : FilterParameters, the defaults if None
    neighbours : sequence of Film
        The frames before and after in a sequence, in which similar patches are searched for too.
    guides : (rows, columns, 2 n) float32, values that differ between surfaces, such as normals, and their variances, in
        units of the difference that matters; only for a film by itself
    threads : int, bands filtered at once; the result does not depend on it

    Raises BadInput if a film cannot be filtered, the films differ in size, or the picture is too small for the number
    of scales.
    """
    parameters = parameters or FilterParameters()
    frames = [samples_of(f.checked()) for f in (film, *neighbours)]
    if guides is not None:
        values = [np.split(array, 2, axis=-1) for array in (frames[0].means, guides) if array is not None]
        frames[0] = replace(frames[0], means=np.concatenate([half[i] for i in (0, 1) for half in values], axis=-1))
    results = fuse_scales(frames, parameters, threads=threads)
    picture = results[0].picture
    if parameters.scales > 1:
        picture = within_range(recombine([r.picture for r in results], parameters.coarse), frames[0].picture)
    if parameters.bound > 0:
        picture = within_noise(picture, film, parameters.bound)
    if parameters.rims:
        rims, _ = lamp_rims(film, picture)
        picture = np.where(np.isnan(rims), picture, rims).astype(np.float32)
    return FilteredFilm(picture, results[0].similar, tuple(float(np.median(r.similar)) for r in results))


def fuse_scales(frames: Sequence[Samples], parameters: FilterParameters, *, threads: int = 1) -> list[Fused]:
    """Filter the first frame by Algorithm 1 at every scale, the finest first; the other frames are its neighbours.

    Histograms and counts determine the weights; pictures may have any number of channels.
    """
    # refuse too many scales for the size: the coarsest picture must hold two patches side by side
    size = frames[0].count.shape
    least = 2 * (2 * parameters.patch + 1)
    coarsest = [-(-n // 2 ** (parameters.scales - 1)) for n in size]
    if min(coarsest) < least:
        raise BadInput(
            f"{parameters.scales} scales need {least} x {least} pixels at the coarsest to compare patches; "
            f"{size[0]} x {size[1]} pixels give {coarsest[0]} x {coarsest[1]}",
            "filter with fewer scales",
        )
    results = []
    for s in range(parameters.scales):
        # at coarser scales a pixel may stay unfiltered: the finest scale ensures that none keeps its noise
        level = frames if s == 0 else [downsample(frame, s) for frame in frames]
        rules = parameters if s == 0 else replace(parameters, at_least=0, ease=0.0)
        results.append(fuse_scale(level[0], rules, neighbours=level[1:], threads=threads))
    return results


def samples_of(film: Film) -> Samples:
    """The film in the filter's form."""
    rows, columns = film.count.shape
    mean = film.mean.astype(np.float32)
    histogram = film.histogram.reshape(rows, columns, 3 * film.histogram.shape[-1])
    # variances of the pixels' means with a lower bound, as few samples can underestimate them
    variance = mean_variance(film)
    known = np.isfinite(variance)
    faint = FAINT * variance[known].mean() if known.any() else 0.0
    safe_variance = np.asarray(np.clip(variance + faint, LEAST_VARIANCE, LARGEST), np.float32)
    return Samples(mean, histogram, film.count.astype(np.float32), np.concatenate([mean, safe_variance], axis=-1))


def downsample(frame: Samples, s: int) -> Samples:
    """The frame at scale s: 2^s times smaller, blurred against aliasing, with the same number of samples in all."""
    rows_columns = tuple(-(-n // 2**s) for n in frame.count.shape)
    histogram = np.zeros((*rows_columns, 0), np.float32)
    if frame.histogram.size:
        histogram = gaussian_downsample(frame.histogram, s)
    count = gaussian_downsample(frame.count[..., None], s)[..., 0]
    factor = np.float32(frame.count.sum(dtype=np.float64) / count.sum(dtype=np.float64))
    histogram *= factor
    means = frame.means
    if means is not None:
        means = gaussian_downsample(means, s)
        means[..., means.shape[-1] // 2 :] /= factor
    return Samples(gaussian_downsample(frame.picture, s), histogram, count * factor, means)


def recombine(pictures: Sequence[Array32], coarse: float) -> Array32:
    """Combine filtered scales, finest first: the low frequencies of each are replaced by the coarser scale's.

    The errors of the scales are partly independent, so that a mean of the two (`coarse` < 1) is better than either.
    """
    result = pictures[-1]
    for finer in pictures[-2::-1]:
        difference = np.float32(coarse) * (result - gaussian_downsample(finer, 1))
        result = finer + bicubic_upsample(difference, finer.shape[:2])
    return result


def allowed_variance(film: Film) -> Array:
    """Variance of each pixel's mean, (rows, columns, 3), raised to that of the pixels around where these are alike.

    A pixel's own samples underestimate it where they miss rare bright paths. Its neighbours are expected to have such
    paths too where their means scatter by their noise alone, and not at the rim of a lamp. Infinite where a pixel and
    its neighbours have a single sample.
    """
    variance = mean_variance(film)
    known = np.isfinite(variance)
    variance = np.where(known, variance, 0.0)
    share = np.maximum(_around(known), 1e-9)
    around = _around(variance) / share
    scatter = _around(film.mean**2) - _around(film.mean) ** 2
    excess = scatter.mean(-1, keepdims=True) / np.maximum(around.mean(-1, keepdims=True), LEAST_VARIANCE)
    alike = np.clip((UNLIKE - excess) / (UNLIKE - ALIKE), 0, 1)
    raised = variance + np.maximum(around - variance, 0) * alike
    return np.where(known, raised, np.inf)


def within_noise(picture: Array32, film: Film, deviations: float) -> Array32:
    """Limit the picture to what the samples of each pixel allow: `deviations` standard deviations of their mean.

    Similar patches with one bright pixel among dark ones would otherwise change the pixels beside a lamp. Where changes
    there are larger than noise explains they are bias, and are reduced in proportion.
    """
    variance = allowed_variance(film)
    most = deviations * np.sqrt(variance)
    change = np.clip(picture - film.mean, -most, most)
    squares = np.mean(change**2 / np.maximum(variance, LEAST_VARIANCE), axis=-1, keepdims=True)
    nearby = ndimage.gaussian_filter(squares, (CHANGE_PX, CHANGE_PX, 0))
    bias = beside_lamps(film)[..., None] & (nearby > EXPLAINED)
    return np.asarray(film.mean + change * np.where(bias, EXPLAINED / np.maximum(nearby, EXPLAINED), 1), np.float32)


def _around(values: npt.ArrayLike) -> Array:
    return np.asarray(ndimage.uniform_filter(np.asarray(values, np.float64), (AROUND_SIDE, AROUND_SIDE, 0)))


def within_range(picture: Array32, noisy: Array32) -> Array32:
    """Limit the picture to the range of the noisy pixels nearby, which avoids a dark rim around a lamp.

    Exchanged low frequencies overshoot next to something much brighter.
    """
    around = np.ones((RANGE_SIDE, RANGE_SIDE), np.uint8)
    return np.clip(picture, cv2.erode(noisy, around), cv2.dilate(noisy, around))


def gaussian_downsample(picture: Array32, s: int) -> Array32:
    """(rows, columns, channels) blurred and sampled at every 2^s-th pixel from the first: ceil(n / 2^s) pixels."""
    return _along_both(picture, *(_gaussian_rows(n, s) for n in picture.shape[:2]))


def bicubic_upsample(picture: Array32, size: tuple[int, ...]) -> Array32:
    """(rows, columns, channels) twice as large, by Keys' cubic (a = -1/2), which keeps the samples."""
    return _along_both(picture, *(_bicubic_rows(n) for n in size))


def _along_both(picture: Array32, along_rows: csr_array, along_columns: csr_array) -> Array32:
    rows, columns, channels = picture.shape
    narrow = (along_rows @ picture.reshape(rows, -1)).reshape(-1, columns, channels)
    return np.stack([along_columns @ row for row in narrow])


def _gaussian_rows(n: int, s: int) -> csr_array:
    """Weights of sum 1 for ceil(n / 2^s) rows; the picture is mirrored at its borders."""
    sigma = SIGMA * np.sqrt(4.0**s - 1.0)
    reach = int(np.ceil(4 * sigma))
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-(offsets**2) / (2 * sigma**2))
    return _mirrored(np.arange(0, n, 2**s)[:, None] + offsets, weights / weights.sum(), n)


def _bicubic_rows(n: int) -> csr_array:
    before = np.arange(n) // 2
    t = np.arange(n) / 2 - before
    near, far = np.stack([t, 1 - t]), np.stack([1 + t, 2 - t])
    inside = (1.5 * near - 2.5) * near**2 + 1
    outside = ((-0.5 * far + 2.5) * far - 4) * far + 2
    weights = np.stack([outside[0], inside[0], inside[1], outside[1]], axis=1)
    return _mirrored(before[:, None] + np.arange(-1, 3), weights, -(-n // 2))


def _mirrored(indices: Indices, weights: Array, n: int) -> csr_array:
    """Matrix (rows, n) of weights (rows, k) at indices (rows, k), which are mirrored at the borders."""
    mirrored = indices % (2 * n)
    mirrored = np.where(mirrored < n, mirrored, 2 * n - 1 - mirrored)
    values, starts = (
        np.broadcast_to(weights, indices.shape).astype(np.float32),
        np.arange(0, indices.size + 1, indices.shape[1]),
    )
    return csr_array((values.ravel(), mirrored.ravel(), starts), shape=(len(indices), n))
