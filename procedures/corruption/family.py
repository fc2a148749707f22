"""Corruptions of a photograph: how each is reported, when a test of it fails, how far an unseen one widens a result.

A test is a score: an estimate of the corruption's strength over its standard uncertainty without that corruption. It
fails beyond the quantile of `FALSE_ALARM` of a standard normal distribution, shared by as many places as were searched.
A nuisance is a strength that is not negative, with a half-normal prior: its posterior's root mean square is the term in
the budget.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

from procedures.outcome import Check, Verdict
from procedures.raw import UNLIKELY_IN_RAW, unprocessed

FALSE_ALARM = 1e-4
"""Probability that a test fails on a photograph without the corruption."""


@dataclass(frozen=True)
class Corruption:
    """A named corruption.

    Attributes
    ----------
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
        """The test by its score, the largest of those at so many places; a score of NaN does not fail."""
        sentence = self.sentence.format(evidence or f"{score:.1f} standard uncertainties")
        remedy, prior = (self.raw_remedy, self.prior_in_raw) if raw else (self.remedy, 1.0)
        return Check(self.name, score, threshold(places), Verdict.DOUBTFUL, sentence, remedy, prior=prior)


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
OVERSHOOT = _processing("overshoot", "{}, and no light is negative: the photograph was sharpened")
SCATTER = Corruption(
    "scatter",
    "the edge scatters by {} more than the noise of its plains explains: it is rough or moved, or a filter spared it",
    "take a cut edge or a finer print, keep the camera still, and take the RAW file",
    "take a cut edge or a finer print, and keep the camera still",
)
PERIODIC = Corruption(
    "period",
    "the MTF rises to {} near 1 cycle/pixel, as no lens makes it: the edge moved, or was printed, with the period at "
    "which it crosses the pixels",
    *2 * ("keep the camera still, turn the chart by 2 degrees, and photograph it again",),
)
FILTERED = _processing("filter", "edges look unlike any image by a lens ({}): the photograph was denoised")
SELECTIVE = _processing("sharpening", "strong detail is sharpened more than faint detail ({})")
WIDE = _processing("sharpening", "light is missing around edges, as by a wide unsharp mask ({})")
GHOSTED = Corruption(
    "ghost",
    "the picture, mirrored through the frame's centre, lies over the chart ({}): the lens reflects light",
    *2 * ("keep bright surfaces out of the frame, and photograph the chart on a dark wall",),
)
PRINT_BLUR = "print blur"
"""Term of the budget: blur of the chart's print, which one photograph cannot distinguish from that of the lens."""
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
