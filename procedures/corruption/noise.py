"""Detection of sharpening from noise: the noise of pixels is white, and an unsharp mask colours it.

A mask of amount a and radius r turns a picture x into x + a (x - g * x), g the Gaussian of standard deviation r. White
noise then has the autocovariance of that kernel: neighbours are anticorrelated. Structure of paper, light or a poor fit
is positively correlated, as imaged by a lens: it can hide a mask but not imitate one. For a slowly varying picture the
differences of pixels give the covariance without its level (a variogram); constants and squares of the distance absorb
slow variation.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.corruption.family import SHARPENED, SMOOTHED, Strength
from procedures.numerics import transforms
from procedures.numerics.arrays import Array
from procedures.outcome import Check

MAX_LAG = 5
"""Greatest distance of a pair, in pixels."""
MASK_RADII, SMOOTHING_RADII = (0.6, 1.0, 2.0), (0.5, 0.7)
"""Radii of the unsharp masks that tests search for in the noise, and of the negative ones that show smoothing."""
TEXTURES = (1.0, 2.0)
"""Textures of paper and walls: exponents of the frequency by which their spectra fall."""
MIN_PAIRS = 500
"""Least number of pairs at one distance."""
DIRECTIONS = 128
"""Directions of a mean over a half turn; J0 is exact to rounding up to an argument of 100."""
CONTRASTS = np.array([[1, -1, -1, 1], [1, -1, 1, -1], [1, 1, -1, -1]])
"""Signs of the four pixels of a cell of a mosaic: diagonals, columns, rows."""
SITES_MODEL = 0.05
"""Standard uncertainty of the logarithm of variances at the sites of a cell, by amplifiers of unlike gain."""
CORRELATED = 1.1
"""Variance of a mean of squared differences from four neighbours in white noise, over that of independent ones."""
COARSEST = 0.02
"""Frequency below which the spectrum of a texture is flat, in cycles/pixel."""

_y, _x = (one.ravel() for one in np.mgrid[0 : MAX_LAG + 1, -MAX_LAG : MAX_LAG + 1])
_kept = ((_y > 0) | (_x > 0)) & (_x**2 + _y**2 <= MAX_LAG**2)
LAG_X, LAG_Y = _x[_kept], _y[_kept]
"""Lags, one of each pair of opposite ones."""
DRIFT = (LAG_X**2 + LAG_Y**2) / MAX_LAG**2
"""Correlations of a slowly varying picture, besides a constant."""


@dataclass(frozen=True)
class Variogram:
    """Half the mean square of differences at the lags `LAG_X`, `LAG_Y`.

    half_square : (l,) float64
    pairs : (l,) number of pairs
    mosaic : logarithm of the ratio of the finest noise's variances in two halves of the cells of 2 x 2 pixels
    """

    half_square: Array
    pairs: Array
    mosaic: Strength

    @classmethod
    def of(cls, picture: Array, known: npt.NDArray[np.bool_]) -> "Variogram":
        """Variogram of a picture (rows, columns) where it is known; its level should be near 0."""
        rows, columns = (transforms.next_fast_len(n + MAX_LAG) for n in picture.shape)
        values = np.where(known, picture, 0.0)
        one, first, second = (
            transforms.rfft2(part, (rows, columns)) for part in (known.astype(np.float64), values, values * values)
        )
        pairs = np.rint(transforms.irfft2(np.abs(one) ** 2, (rows, columns)))[LAG_Y, LAG_X]
        squares = transforms.irfft2((second * one.conj()).real - np.abs(first) ** 2, (rows, columns))[LAG_Y, LAG_X]
        return cls(squares / np.maximum(pairs, 1), pairs, _mosaic(values, known))

    def inflation(self, variance: float) -> float:
        """Variance of the mean of many neighbours over that of as many white samples of this variance, at least 1."""
        return max(1 + 2 * float(np.sum(1 - self.half_square / variance)), 1.0) if variance > 0 else 1.0

    @property
    def finest(self) -> float:
        """Variance of white noise with the same power at the highest frequencies, where no lens passes detail."""
        near = {(x, y): v for x, y, v in zip(LAG_X.tolist(), LAG_Y.tolist(), self.half_square.tolist(), strict=True)}
        return float(near[1, 0] + near[0, 1] - (near[1, 1] + near[-1, 1]) / 2)


def _mosaic(values: Array, known: npt.NDArray[np.bool_]) -> Strength:
    """Largest contrast of the variance of a pixel less the mean of its neighbours: checkerboard, columns or rows.

    Interpolated pixels differ less from their neighbours (Gallagher and Chen, CVPR Workshops 2008).
    """
    inside = known[1:-1, 1:-1] & known[:-2, 1:-1] & known[2:, 1:-1] & known[1:-1, :-2] & known[1:-1, 2:]
    mean = (values[:-2, 1:-1] + values[2:, 1:-1] + values[1:-1, :-2] + values[1:-1, 2:]) / 4
    square = (values[1:-1, 1:-1] - mean) ** 2
    sites = [square[i::2, j::2][inside[i::2, j::2]] for i in (0, 1) for j in (0, 1)]
    if min(len(site) for site in sites) < MIN_PAIRS or not square[inside].any():
        return Strength()
    means = np.array([site.mean() for site in sites])
    variance = np.array([CORRELATED * site.var() / len(site) for site in sites]) / np.maximum(means, 1e-300) ** 2
    logarithm = np.log(np.maximum(means, 1e-6 * means.max()))
    contrast = max(abs(float(signs @ logarithm)) / 2 for signs in CONTRASTS)
    return Strength(contrast, math.hypot(float(variance.sum()) ** 0.5 / 2, SITES_MODEL))


def mask_scores(
    variograms: Sequence[Variogram], radii: Sequence[float], nuisances: Sequence[Array] = ()
) -> list[Strength]:
    """Score of a mask of each radius in the noise: an amount a of radius r gives white noise the correlation -2 a
    g(lag), g a Gaussian of unit volume; a constant and `nuisances` are fitted too."""
    known = [one for one in variograms if one.pairs.min() >= MIN_PAIRS and one.half_square.min() > 0]
    if not known:
        return [Strength() for _ in radii]
    columns = np.stack([np.ones(len(LAG_X)), *nuisances, *(_first_order(radius) for radius in radii)], axis=1)
    normal, right = (
        columns.T @ (columns * np.sum([one.pairs for one in known], axis=0)[:, None]),
        np.zeros(columns.shape[1]),
    )
    for one in known:
        right += columns.T @ (one.pairs * (1 - one.half_square / np.average(one.half_square, weights=one.pairs)))
    free, scores = 1 + len(nuisances), []
    for i in range(len(radii)):
        used = [*range(free), free + i]
        covariance = np.linalg.pinv(normal[np.ix_(used, used)])
        scores.append(Strength(float(covariance[-1] @ right[used]), float(covariance[-1, -1]) ** 0.5))
    return scores


def noise_checks(masks: Sequence[Strength], smoothing: Sequence[Strength], *, raw: bool) -> list[Check]:
    """Tests of sharpening and of smoothing by the noise: the largest score of all radii counts."""
    return [
        SHARPENED.check(max(mask.score for mask in masks), raw=raw, places=len(masks)),
        SMOOTHED.check(max(-one.score for one in smoothing), raw=raw, places=len(smoothing)),
    ]


def _first_order(radius_px: float) -> Array:
    """Derivative of the correlations of white noise (l,) by the amount of a mask, at 0."""
    return np.asarray(-np.exp(-(LAG_X**2 + LAG_Y**2) / (2 * radius_px**2)) / (np.pi * radius_px**2))


def combined_scores(first: Sequence[Strength], second: Sequence[Strength]) -> list[Strength]:
    """Scores of the same masks by independent fields together."""
    combined = []
    for one, other in zip(first, second, strict=True):
        weights = np.array([one.uncertainty, other.uncertainty]) ** -2.0
        information = float(weights.sum())
        amount = float(weights @ [one.value, other.value]) / information if information else 0.0
        combined.append(Strength(amount, information**-0.5 if information else np.inf))
    return combined


def texture_correlation(frequencies: Array, mtf: Array, exponent: float = 0.0) -> Array:
    """Correlations (l,) of a texture that a lens images: of the spectrum MTF^2 / f^exponent, in all directions."""
    power = frequencies * mtf**2 / np.maximum(frequencies, COARSEST) ** exponent
    distances, at = np.unique(np.hypot(LAG_X, LAG_Y), return_inverse=True)
    phases = 2 * np.pi * distances[:, None] * frequencies
    # Bessel's function J0 as a mean over directions; scipy.special takes long to load
    waves = np.mean([np.cos(phases * np.sin(np.pi * (i + 0.5) / DIRECTIONS)) for i in range(DIRECTIONS // 2)], axis=0)
    return np.asarray((waves @ power / power.sum())[at])
