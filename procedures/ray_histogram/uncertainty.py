"""How far the filtered picture may be from the truth: its standard uncertainty, pixel by pixel.

Once its weights are chosen the filter is linear in the picture, so that it tells of itself what it does to others:

- *noise*: pictures of nothing but noise, as strong in each pixel as the film says, go through the same weights at all
  scales; what is left of them is what is left of the film's own;
- *bias*: so does the filtered picture itself; what a second filtering changes, the first did alike to the truth. That
  picture has lost some detail already, for which `LOST_DETAIL` makes up;
- *what is seen besides*: the film lies farther from the filtered picture than its noise takes it, as the weights were
  chosen by looking at the same samples, and detail weaker than the noise is not in the picture that is filtered again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from procedures.outcome import BadInput
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_noise import mean_variance
from procedures.ray_histogram.filter import FilterParameters, Samples
from procedures.ray_histogram.multiscale import fuse_scales, recombine, samples_of

Floats = npt.NDArray[np.float32]

DRAWS = 8
"""Pictures of noise: their variance in a pixel is known to half of itself, and averaged over `NOISE_PX` then."""
NOISE_PX = 2.0
"""Standard deviation of the neighbourhood over which the variance of the draws is averaged, pixels."""
BIAS_PX = 1.0
"""The same for the square of the bias, which changes from pixel to pixel along edges."""
LOST_DETAIL = 2.0
"""Mean square of the true bias over that of the estimated one: 1.9 on the Cornell box at 64 samples, 2.0 at 256."""
SEEN_PX = 3.0
"""The same for what the film shows besides, once for its mean and once more for the mean's own noise."""
SURE_PX = 8.0
"""Standard deviation of the neighbourhood in which that is to be seen at all: on a flat wall it is chance."""
SEED = 4


def standard_uncertainty(
    film: Film,
    smooth: Floats,
    parameters: FilterParameters | None = None,
    *,
    neighbours: Sequence[tuple[Film, Floats]] = (),
    threads: int = 1,
) -> Floats:
    """Standard uncertainty of the film's filtered picture, (rows, columns, 3), linear.

    Parameters
    ----------
    film : Film
        Of at least two samples in each pixel.
    smooth : (rows, columns, 3) float32
        The film's picture, filtered: in the place of the truth.
    parameters : FilterParameters
        Those the picture was filtered with.
    neighbours : sequence of (Film, (rows, columns, 3))
        The frames it was filtered with, and each one's picture, filtered in the same way.
    threads : int
        Bands filtered at once.

    Raises
    ------
    BadInput
        If a pixel has a single sample, or the film cannot be filtered.
    """
    parameters = parameters or FilterParameters()
    probes = [_probe(one.checked(), picture, i) for i, (one, picture) in enumerate(((film, smooth), *neighbours))]
    results = [found.picture for found in fuse_scales(probes, parameters, threads=threads)]
    answer, shape = recombine(results, parameters.coarse), (*smooth.shape[:2], DRAWS, 3)
    bias2 = (answer[..., :3] - smooth) ** 2
    noise, before = answer[..., 3:].reshape(shape), probes[0].picture[..., 3:].reshape(shape)
    variance = _around(np.mean(noise**2, axis=2), NOISE_PX) + np.float32(LOST_DETAIL) * _around(bias2, BIAS_PX)
    shared = np.mean(noise * before, axis=2)
    return np.asarray(np.sqrt(variance + _seen_besides(film, smooth, shared, variance)), np.float32)


def _seen_besides(film: Film, smooth: Floats, shared: Floats, variance: Floats) -> Floats:
    """Mean square error (rows, columns, 1) about each pixel that the film shows, beyond a variance told already.

    shared : covariance of the film's noise and what the filter leaves of it. The film less the filtered picture has the
    variance of its noise, and the picture's mean square error, less twice that.
    """
    apart = (film.mean - smooth) ** 2 - mean_variance(film) + 2 * shared
    beyond = (apart - variance).mean(axis=-1, keepdims=True).astype(np.float32)
    wide = _around(beyond, SURE_PX)
    chance = np.sqrt(_around((beyond - wide) ** 2, SURE_PX) / (4 * np.pi * SURE_PX**2))
    share = np.clip(wide / np.maximum(chance, 1e-12), 0, 1) ** 2
    return np.asarray(share * _around(np.maximum(_around(beyond, SEEN_PX), 0), SEEN_PX), np.float32)


def coverage(picture: npt.NDArray[np.floating], uncertainty: Floats, truth: npt.NDArray[np.floating]) -> float:
    """Share of the values that are within two standard uncertainties of the truth."""
    return float(np.mean(np.abs(picture - truth) <= 2 * uncertainty))


def _probe(film: Film, smooth: Floats, seed: int) -> Samples:
    """The film with the filtered picture, and pictures of noise alone, in the place of its own."""
    single = film.count < 2
    if single.any():
        raise BadInput(f"{int(single.sum())} pixels have a single sample", "cast two or more: one tells no noise")
    frame = samples_of(film)
    draws = np.random.default_rng([SEED, seed]).standard_normal((*frame.count.shape, DRAWS, 3), np.float32)
    draws *= np.sqrt(mean_variance(film)).astype(np.float32)[..., None, :]
    planes = np.concatenate([smooth, draws.reshape(*frame.count.shape, -1)], axis=-1)
    return replace(frame, picture=np.ascontiguousarray(planes, np.float32))


def _around(squares: Floats, sigma_px: float) -> Floats:
    return np.asarray(ndimage.gaussian_filter(squares, (sigma_px, sigma_px, 0)), np.float32)
