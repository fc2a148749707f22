"""Corruptions of a photograph: how each is reported, when a test of it fails, how far an unseen one widens a result.

A test is a score: an estimate of the corruption's strength over its standard uncertainty without that corruption. It
fails beyond the quantile of `FALSE_ALARM` of a standard normal distribution, shared by as many places as were searched.
A nuisance is a strength that is not negative, with a half-normal prior: its posterior's root mean square is the term in
the budget.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from procedures.numerics.arrays import Array, Array32, Indices
from procedures.outcome import Check, Verdict
from procedures.raw import UNLIKELY_IN_RAW, unprocessed

FALSE_ALARM = 1e-4
"""Probability that a test fails on a photograph without the corruption."""


@dataclass(frozen=True)
class Corruption:
    """A named corruption.

    name : its check, and its term in a budget
    sentence : what the photograph shows of it; `{}` is the evidence
    remedy, raw_remedy : of a picture, and of a RAW file
    prior_in_raw : how likely it is in a RAW file, relative to a picture
    """

    name: str
    sentence: str
    remedy: str
    raw_remedy: str
    prior_in_raw: float = 1.0

    def check(self, score: float, evidence: str = "", *, raw: bool, places: int = 1) -> Check:
        """The test by its score, the largest of those at so many places; a score of NaN is none."""
        sentence = self.sentence.format(evidence or f"{score:.1f} standard uncertainties")
        remedy, prior = (self.raw_remedy, self.prior_in_raw) if raw else (self.remedy, 1.0)
        given = not math.isnan(score)
        return Check(self.name, score, threshold(places), Verdict.DOUBTFUL, sentence, remedy, given=given, prior=prior)


def _processing(name: str, sentence: str) -> Corruption:
    """One that a program makes, or hardly ever a camera in its RAW files."""
    remedy = "take the RAW file: processing is no property of the lens"
    return Corruption(name, sentence, remedy, unprocessed(True, ""), UNLIKELY_IN_RAW)


SHARPENED = _processing(
    "sharpening", "the noise of neighbouring pixels is anticorrelated ({}): the photograph was sharpened"
)
SMOOTHED = _processing(
    "smoothing",
    "the noise of neighbouring pixels is correlated ({}): the photograph was denoised, resampled or demosaicked",
)
TONE_CURVE = _processing("tone", "the bright side has less noise than the dark one ({}), as a tone curve makes it")
MOSAIC = _processing(
    "mosaic",
    "the finest noise differs between the sites of a mosaic ({}): pixels were interpolated from their neighbours",
)
OVERSHOOT = _processing("overshoot", "{}, and no light is negative: the photograph was sharpened")
SCATTER = Corruption(
    "scatter",
    "the edge scatters by {} more than the noise of its plains explains: it is rough or moved, or a filter spared it",
    "take a cut edge or a finer print, keep the camera still, and take the RAW file",
    "take a cut edge or a finer print, and keep the camera still",
)
SPARED = _processing(
    "scatter", "the edge has less noise than its plains ({}): local contrast or a tone curve raised theirs"
)
PERIODIC = Corruption(
    "period",
    "the MTF rises to {} near 1 cycle/pixel, as no lens makes it: the edge moved, or was printed, with the period at "
    "which it crosses the pixels",
    *2 * ("keep the camera still, turn the chart by 2 degrees, and photograph it again",),
)
FILTERED = _processing("filter", "edges look unlike any image by a lens ({}): the photograph was denoised")
ADAPTED = _processing("filter", "faint detail is smoother than strong detail ({}): the photograph was denoised")
SELECTIVE = _processing("sharpening", "strong detail is sharpened more than faint detail ({})")
WIDE = _processing("sharpening", "light is missing around edges, as by a wide unsharp mask ({})")
GHOSTED = Corruption(
    "ghost",
    "the picture, mirrored through the frame's centre, lies over the chart ({}): the lens reflects light",
    *2 * ("keep bright surfaces out of the frame, and photograph the chart on a dark wall",),
)
VEILED = Corruption(
    "veil",
    "light is scattered farther than the plains reach ({})",
    *2 * ("keep stray light away, clean the lens, or give a wider region",),
)


def threshold(places: int = 1) -> float:
    """Score beyond which a test fails that was made at so many places, of which the largest score counts."""
    return NormalDist().inv_cdf(1 - FALSE_ALARM / places)


def nuisance(estimate: float, uncertainty: float, prior: float, present: float = 1.0) -> float:
    """Root mean square of a strength >= 0, known to `estimate` with an uncertainty: with probability `present`
    half-normal of standard deviation `prior`, otherwise 0."""
    if not math.isfinite(uncertainty):
        return prior * math.sqrt(present)
    share = prior**2 / (prior**2 + uncertainty**2)
    mean, spread = estimate * share, uncertainty * math.sqrt(share)
    normal, at = NormalDist(), mean / spread
    if present < 1:
        # ratio of the estimate's probability densities with and without the corruption
        gain = 2 * normal.cdf(at) * math.sqrt(1 - share) * math.exp(min(at**2 / 2, 500.0))
        odds = present / (1 - present) * gain
        return math.sqrt(odds / (1 + odds)) * nuisance(estimate, uncertainty, prior)
    if at < -5:  # far on the wrong side the posterior falls as an exponential of length spread / -at
        return math.sqrt(2) * spread / -at
    return math.sqrt(mean**2 + spread**2 + mean * spread * normal.pdf(at) / normal.cdf(at))


# Score tests of corruptions by the residual of a fit: strengths along directions that the fit's model cannot follow.
# The residual r of a fit with the columns M, in units of the noise, is regressed on a direction g whose part within M
# is removed: with P that projection, the strength is g'P r / g'P g. Its uncertainty is the larger one of two: by the
# noise, and by the scatter of the contributions g'P r of parts of the picture, which includes model errors.


@dataclass(frozen=True)
class Strength:
    """Strength of a corruption and its standard uncertainty, infinite where the data do not determine it."""

    value: float = 0.0
    uncertainty: float = np.inf

    @property
    def score(self) -> float:
        """The strength over its uncertainty."""
        return self.value / self.uncertainty

    @property
    def unseen(self) -> float:
        """The strength, at most what a test lets pass."""
        return min(self.value, threshold() * self.uncertainty) if np.isfinite(self.uncertainty) else 0.0


@dataclass(frozen=True)
class SampleGroup:
    """Samples with nuisance parameters of their own.

    shared : (m, n) float32 columns of the parameters that all parts share, divided by the noise
    own : (m, p) columns of its own nuisance parameters
    residual : (m,) float64
    cluster : (m,) int64 numbers, from 0, of the places whose contributions are independent
    """

    shared: Array32
    own: Array
    residual: Array
    cluster: Indices

    def without_own(self, columns: Array) -> Array:
        """Columns (m, d) without what the part's own parameters explain."""
        return np.asarray(columns - self.own @ (np.linalg.pinv(self.own.T @ self.own) @ (self.own.T @ columns)))

    def projected_gram(self) -> Array:
        """Gram matrix (n, n) of the shared columns without the part's own parameters."""
        AZ = (self.shared.T @ self.own.astype(np.float32)).astype(np.float64)
        AA = np.asarray(self.shared.T @ self.shared, dtype=np.float64)
        return np.asarray(AA - AZ @ np.linalg.pinv(self.own.T @ self.own) @ AZ.T)


def strengths(parts: Sequence[SampleGroup], directions: Sequence[Array], gram: Array, noise: float) -> list[Strength]:
    """Strength along each direction, each by itself.

    directions : values in each part, divided by the noise
    gram : (n, n) sum of the parts' projected Gram matrices, with the priors of the shared parameters
    noise : standard deviation of the residual
    """
    columns = [np.column_stack([direction, part.residual]) for part, direction in zip(parts, directions, strict=True)]
    free = [part.without_own(column) for part, column in zip(parts, columns, strict=True)]
    right = np.sum([part.shared.T @ one.astype(np.float32) for part, one in zip(parts, free, strict=True)], axis=0)
    followed = np.linalg.solve(gram, right.astype(np.float64)).astype(np.float32)
    left = [
        one - part.without_own((part.shared @ followed).astype(np.float64))
        for part, one in zip(parts, free, strict=True)
    ]
    power = np.maximum(sum(np.sum(one[:, :-1] ** 2, axis=0) for one in left), 1e-30)
    value = sum(one[:, -1] @ one[:, :-1] for one in left) / power
    square, count = np.zeros(len(value)), 0
    for part, one in zip(parts, left, strict=True):
        places = int(part.cluster.max(initial=-1)) + 1
        terms = one[:, :-1] * (one[:, -1:] - one[:, :-1] * value)
        square += [float(np.sum(np.bincount(part.cluster, term, places) ** 2)) for term in terms.T]
        count += places
    scatter = np.sqrt(square * count / max(count - 1, 1)) / power
    return [Strength(float(a), float(max(noise * p**-0.5, u))) for a, p, u in zip(value, power, scatter, strict=True)]
