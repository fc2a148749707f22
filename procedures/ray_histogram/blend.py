"""Blend of several pictures of one render, weighted pixel by pixel by cross-validation between halves of its samples.

Each half is filtered by itself and compared with the unfiltered film of the other half, whose error is independent of
it and zero in the mean. The weight of a candidate minimises the squared difference near each pixel, in units of the
variance; the weights found on the halves are applied to the candidates of all samples. The same differences give the
standard uncertainty: what the other half's noise does not explain is the squared error.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from procedures.display import summary
from procedures.numerics.arrays import Array, Array32
from procedures.outcome import BadInput
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_noise import mean_variance
from procedures.ray_histogram.filter import FilterParameters
from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
from procedures.ray_histogram.regression import regress
from procedures.ray_histogram.rims import lamp_rims
from procedures.ray_histogram.uncertainty import weighting_variance

Denoiser = Callable[["Render"], npt.NDArray[np.floating]]
"""A filter from outside: it takes the film's picture and its features."""

HISTOGRAMS, STRICTER, DEMODULATED = "histograms", "histograms, half of kappa", "histograms of the light"
REGRESSED = "regression"
DENOISED, UNFILTERED = "denoiser", "unfiltered"  # the candidates, in the order in which they are blended
WEIGHT_PX = 4.0  # standard deviation of the neighbourhood in which a weight is determined, pixels
SIGNIFICANCE = 4.0
"""A candidate's weight is reduced by this factor times its squared relative error, so that chance adds no noise."""
ERROR_PX = 4.0  # standard deviation of the neighbourhood over which squared errors are averaged, pixels
CHANCE = 0.2  # standard deviations subtracted from squared biases, as chance makes those above zero that are zero
NOISE_PX = 2.0
"""Standard deviation of the neighbourhood over which the noise is averaged, which differs more between pixels."""
SMOOTH_PX = 1.0  # standard deviation by which weights are smoothed
ALBEDO_STEP, GUIDE_STEPS = 0.2, 5.0
"""Differences of albedo, and of guides in their units, over which a regression takes light as linear."""
LEAST_ALBEDO = 0.05  # pixels that reflect less are not divided by their albedo: lamps, glass and metal


@dataclass(frozen=True)
class Render:
    """A film, or a half of it, with what the renderer knows of the surfaces.

    film : Film, the light of the picture
    albedo : (rows, columns, 3) float64 or None, diffuse reflectance of the surfaces
    light : Film or None, the film of the samples divided by `divisor(albedo)`: without texture, more pixels are similar
    normal : (rows, columns, 3) or None, normals of the surfaces
    guides : (rows, columns, 2 n) float32 or None, features for `filter_film`
    """

    film: Film
    albedo: Array | None = None
    light: Film | None = None
    normal: Array | None = None
    guides: Array32 | None = None

    __repr__ = summary


def divisor(albedo: npt.NDArray[np.floating]) -> Array:
    """The albedo to divide by: 1 where a surface reflects almost nothing diffusely, and at most 1."""
    limited = np.clip(albedo.astype(np.float64), LEAST_ALBEDO, 1.0)
    return np.where(albedo.max(-1, keepdims=True) < LEAST_ALBEDO, 1.0, limited)


def blend(
    halves: tuple[Render, Render],
    whole: Render,
    parameters: FilterParameters | None = None,
    *,
    denoiser: Denoiser | None = None,
    threads: int = 1,
) -> tuple[FilteredFilm, dict[str, float]]:
    """The blended picture with its standard uncertainty, and the mean weight of each candidate.

    Raises BadInput if a film cannot be filtered, or a half has a single sample in a pixel.

    halves : (Render, Render) two disjoint halves of the samples
    whole : Render, all samples
    parameters : FilterParameters, those of the histogram filter; the defaults if None
    denoiser : callable, one more candidate
    threads : int, bands filtered at once
    """
    for half in halves:
        if (half.film.count < 2).any():
            raise BadInput("each half needs two samples per pixel to estimate noise", "cast four samples or more")
    parameters = parameters or FilterParameters()
    plain = replace(parameters, rims=False)  # they are determined best from all samples
    (first, _), (second, _), (answer, filtered) = (
        _candidates(one, plain, denoiser, threads) for one in (*halves, whole)
    )
    films = halves[0].film, halves[1].film
    weights = cross_validated(films, first, second)
    picture, a, b = (_mix(candidates, weights) for candidates in (answer, first, second))
    sigma: npt.NDArray[np.floating] = _uncertainty(films, (a, b))
    if parameters.rims:
        values, spread = lamp_rims(whole.film, picture)
        picture, sigma = np.where(np.isnan(values), picture, values), np.where(np.isnan(spread), sigma, spread)
    shares = {name: float(weight.mean()) for name, weight in weights.items()}
    return replace(filtered, picture=picture.astype(np.float32), uncertainty=sigma.astype(np.float32)), shares


def _candidates(
    render: Render, parameters: FilterParameters, denoiser: Denoiser | None, threads: int
) -> tuple[dict[str, Array], FilteredFilm]:
    film = render.film.checked()
    filtered = filter_film(film, parameters, threads=threads)
    pictures: dict[str, npt.NDArray[np.floating]] = {HISTOGRAMS: filtered.picture}
    pictures[STRICTER] = filter_film(film, replace(parameters, kappa=parameters.kappa / 2), threads=threads).picture
    if render.light is not None and render.albedo is not None:
        light = filter_film(render.light, parameters, guides=render.guides, threads=threads).picture
        pictures[DEMODULATED] = light * divisor(render.albedo)
    pictures[REGRESSED] = regress(film, _features(render), threads=threads)
    if denoiser is not None:
        pictures[DENOISED] = denoiser(render)
    pictures[UNFILTERED] = film.mean
    return {name: picture.astype(np.float64) for name, picture in pictures.items()}, filtered


def _features(render: Render) -> Array:
    """Albedo, normals and depth in units of the differences over which light is nearly linear, (rows, columns, n)."""
    known = [np.zeros((*render.film.count.shape, 0))]
    if render.albedo is not None:
        known.append(render.albedo / ALBEDO_STEP)
    if render.guides is not None:
        known.append(np.split(render.guides, 2, axis=-1)[0] / GUIDE_STEPS)
    return np.concatenate(known, axis=-1, dtype=np.float64)


def cross_validated(
    films: tuple[Film, Film], first: Mapping[str, Array], second: Mapping[str, Array]
) -> dict[str, Array]:
    """Weights (rows, columns, 1) of the candidates of two halves, of sum 1: each is compared with the other's film.

    The candidates are added one after another. For the difference d of a new one from the blend so far, r the
    difference of the other half's film from that blend and v its variance, the best weight is sum(r d / v) /
    sum(d^2 / v) near the pixel, with the variance sum(d^2 / v) of the numerator.
    """
    names = list(first)
    va, vb = (weighting_variance(film) for film in films)
    weights = {names[0]: np.ones((*films[0].count.shape, 1))}
    a, b = first[names[0]], second[names[0]]
    for name in names[1:]:
        da, db = first[name] - a, second[name] - b
        agreement = (films[1].mean - a) * da / vb + (films[0].mean - b) * db / va
        size = (da**2 / vb + db**2 / va).sum(-1, keepdims=True)
        numerator = _around(agreement.sum(-1, keepdims=True), WEIGHT_PX)
        chance = _around(size, WEIGHT_PX / np.sqrt(2)) / (4 * np.pi * WEIGHT_PX**2)
        significant = 1 - SIGNIFICANCE * chance / np.maximum(numerator, 1e-9) ** 2
        weight = numerator / (_around(size, WEIGHT_PX) + 1e-12) * np.clip(significant, 0, 1)
        weight = _around(np.clip(weight, 0, 1), SMOOTH_PX)
        a, b = a + weight * da, b + weight * db
        weights = {**{other: (1 - weight) * old for other, old in weights.items()}, name: weight}
    return weights


def _mix(pictures: Mapping[str, Array], weights: Mapping[str, Array]) -> Array:
    return np.asarray(np.sum([weights[name] * picture for name, picture in pictures.items()], axis=0))


def _uncertainty(films: tuple[Film, Film], pictures: tuple[Array, Array]) -> Array32:
    """Standard uncertainty of the blend of all samples, from the blends of the halves.

    A half's picture differs from the other half's film by its own squared error and the film's noise; the two pictures
    differ by twice the variance of one. Of all samples that variance is half as large, the bias is the same.
    """
    (a, b), (first, second) = pictures, films
    scale = 1 / (weighting_variance(first) + weighting_variance(second))
    error = ((a - second.mean) ** 2 - mean_variance(second) + (b - first.mean) ** 2 - mean_variance(first)) / 2
    noise = (a - b) ** 2 / 2
    total = _around(scale, ERROR_PX)
    wide = _around(noise * scale, ERROR_PX) / total
    chance = _around(((error - noise) * scale) ** 2, ERROR_PX / np.sqrt(2)) / (4 * np.pi * ERROR_PX**2) / total**2
    bias2 = np.maximum(_around(error * scale, ERROR_PX) / total - wide - CHANCE * np.sqrt(chance), 0)
    sigma = np.sqrt(bias2 + np.maximum(_around(noise, NOISE_PX), wide) / 2).astype(np.float32)
    return np.maximum(sigma, np.spacing(np.abs(a + b).astype(np.float32)))  # a light without noise is still rounded


def _around(values: Array, sigma_px: float) -> Array:
    return np.asarray(ndimage.gaussian_filter(values, (sigma_px, sigma_px, 0)))


def open_image_denoise(render: Render) -> Array32:
    """The film's picture by Intel Open Image Denoise, with albedo and normals where known.

    Raises BadInput if the package pyoidn is missing.
    """
    try:
        from pyoidn.denoise import denoise
    except ImportError as error:
        remedy = "pip install 'calibration-station[denoise]'"
        raise BadInput("Open Image Denoise requires the package pyoidn", remedy) from error
    features: dict[str, Array32] = {}
    if render.albedo is not None:
        features["albedo"] = _single(np.clip(render.albedo, 0, 1))
        if render.normal is not None:
            features["normal"] = _single(render.normal)
    picture: Array32 = denoise(_single(np.maximum(render.film.mean, 0)), hdr=True, **features)
    return picture


def _single(values: Array) -> Array32:
    return np.ascontiguousarray(values, np.float32)
