"""Standard uncertainty of the filtered picture, pixel by pixel.

With its weights fixed the filter is linear in the picture, so its errors can be propagated:

- *noise*: pictures of pure noise with the film's variance in each pixel pass through the same weights at all scales;
  their variance after filtering is that of the film's noise;
- *bias*: the change of the filtered picture under a second filtering estimates the bias of the first. The filtered
  picture has lost some detail already, which `LOST_DETAIL` compensates;
- *excess*: the film differs from the filtered picture by more than its noise, as the weights were chosen from the same
  samples, and detail below the noise is absent from the picture that is filtered again.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from procedures.numerics.arrays import Array, Array32
from procedures.outcome import BadInput
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_noise import mean_variance
from procedures.ray_histogram.filter import FilterParameters, Samples
from procedures.ray_histogram.multiscale import allowed_variance, fuse_scales, recombine, samples_of
from procedures.ray_histogram.rims import lamp_rims

DRAWS = 8
"""Pictures of noise: their variance in a pixel has a relative error of one half, and is then averaged (`NOISE_PX`)."""
NOISE_PX = 2.0  # standard deviation of the neighbourhood over which the variance of the draws is averaged, pixels
BIAS_PX = 1.0  # standard deviation for averaging the squared bias, which varies from pixel to pixel along edges
LOST_DETAIL = 2.0
"""Mean square of the true bias over that of the estimated one: 1.9 on the Cornell box at 64 samples, 2.0 at 256."""
EXCESS_PX = 8.0
"""Standard deviation of the neighbourhood over which the excess is averaged: a single one is mostly chance."""
RELATIVE_VARIANCE, DARK = 1e-2, 0.01
"""Lower bound of the variance in weights: this fraction of the squared value, plus that of a dark pixel."""
SMOOTH_PX = 1.0  # standard deviation of the neighbourhood whose variance bounds a pixel's in weights
SEED = 4


def standard_uncertainty(
    film: Film,
    smooth: Array32,
    parameters: FilterParameters | None = None,
    *,
    neighbours: Sequence[tuple[Film, Array32]] = (),
    threads: int = 1,
) -> Array32:
    """Standard uncertainty of a film's filtered picture, (rows, columns, 3), linear.

    Raises BadInput if a pixel has a single sample, or the film cannot be filtered.

    film : Film, at least two samples in each pixel
    smooth : (rows, columns, 3) float32, the filtered picture, in place of the truth
    parameters : FilterParameters, parameters of the filtering
    neighbours : sequence of (Film, (rows, columns, 3))
        The frames it was filtered with, and their pictures, filtered in the same way.
    threads : int, bands filtered at once
    """
    parameters = parameters or FilterParameters()
    frames = ((film, smooth), *neighbours)
    probes = [_probe(frame.checked(), picture, i) for i, (frame, picture) in enumerate(frames)]
    results = [fused.picture for fused in fuse_scales(probes, parameters, threads=threads)]
    answer, shape = recombine(results, parameters.coarse), (*smooth.shape[:2], DRAWS, 3)
    bias2 = (answer[..., :3] - smooth) ** 2
    noise, before = answer[..., 3:].reshape(shape), probes[0].picture[..., 3:].reshape(shape)
    variance = _around(np.mean(noise**2, axis=2), NOISE_PX) + np.float32(LOST_DETAIL) * _around(bias2, BIAS_PX)
    shared = np.mean(noise * before, axis=2)
    sigma = np.asarray(np.sqrt(variance + _excess(film, smooth, shared, variance)), np.float32)
    if parameters.rims:
        _, rims = lamp_rims(film, smooth)
        sigma = np.where(np.isnan(rims), sigma, rims).astype(np.float32)
    return sigma


def _excess(film: Film, smooth: Array32, shared: Array32, variance: Array32) -> Array32:
    """Mean square error (rows, columns, 1) near each pixel in excess of an estimated variance.

    shared : covariance of the film's noise before and after filtering. The difference of film and filtered picture has
    the variance of the film's noise plus the picture's mean square error less twice that covariance.
    """
    error = (film.mean - smooth) ** 2 - mean_variance(film) + 2 * shared
    beyond, precise = (error - variance).mean(-1, keepdims=True), 1 / weighting_variance(film).mean(-1, keepdims=True)
    excess = _around(beyond * precise, EXCESS_PX) / _around(precise, EXCESS_PX)
    return np.asarray(np.maximum(excess, 0), np.float32)


def weighting_variance(film: Film) -> Array:
    """Variance of each pixel's mean, (rows, columns, 3), for weights: bounded below, and never far below those beside.

    A pixel whose few samples happen to agree would otherwise count most.
    """
    variance = allowed_variance(film) + RELATIVE_VARIANCE * (film.mean**2 + DARK)
    return np.asarray(np.maximum(variance, ndimage.gaussian_filter(variance, (SMOOTH_PX, SMOOTH_PX, 0))))


def coverage(picture: npt.NDArray[np.floating], uncertainty: Array32, truth: npt.NDArray[np.floating]) -> float:
    """Fraction of the values within two standard uncertainties of the truth."""
    return float(np.mean(np.abs(picture - truth) <= 2 * uncertainty))


def _probe(film: Film, smooth: Array32, seed: int) -> Samples:
    """The film's samples with the filtered picture, and pictures of pure noise, in place of its own picture."""
    single = film.count < 2
    if single.any():
        raise BadInput(
            f"each pixel needs two samples to estimate noise; {int(single.sum())} pixels have a single sample",
            "cast two or more",
        )
    frame = samples_of(film)
    draws = np.random.default_rng([SEED, seed]).standard_normal((*frame.count.shape, DRAWS, 3), np.float32)
    draws *= np.sqrt(mean_variance(film)).astype(np.float32)[..., None, :]
    planes = np.concatenate([smooth, draws.reshape(*frame.count.shape, -1)], axis=-1)
    return replace(frame, picture=np.ascontiguousarray(planes, np.float32))


def _around(squares: Array32, sigma_px: float) -> Array32:
    return np.asarray(ndimage.gaussian_filter(squares, (sigma_px, sigma_px, 0)), np.float32)
