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

FALSE_ALARM = 0.001
"""Probability that a test fails on a photograph without the corruption."""


@dataclass(frozen=True)
class Corruption:
    """A named corruption.

    Attributes
    ----------
    name : str
        Its term in a budget, and its check.
    sentence : str
        What the photograph shows of it.
    remedy : str
    processing : bool
        Whether it is made by a program, not by optics, print or motion: then RAW files hardly have it.
    """

    name: str
    sentence: str
    remedy: str
    processing: bool = False

    def check(self, score: float, detail: str = "", *, raw: bool, places: int = 1, given: bool = True) -> Check:
        """The test of this corruption by its score; `detail` is put into the sentence."""
        return Check(
            self.name, score, threshold(places), Verdict.DOUBTFUL,
            self.sentence.format(detail or f"{score:.1f} standard uncertainties"),
            unprocessed(raw, self.remedy) if self.processing else self.remedy,
            given=given, prior=UNLIKELY_IN_RAW if raw and self.processing else 1.0,
        )  # fmt: skip


TAKE_RAW = "take the RAW file: processing is no property of the lens"
SHARPENED = Corruption(
    "sharpening", "the noise of neighbouring pixels is anticorrelated ({}): the photograph was sharpened", TAKE_RAW, True
)
SMOOTHED = Corruption(
    "smoothing", "the noise of neighbouring pixels is correlated ({}): the photograph was denoised, resampled or "
    "demosaicked", TAKE_RAW, True,
)  # fmt: skip
TONE_CURVE = Corruption(
    "tone curve", "the noise is less in the bright than in the dark ({}), as a tone curve makes it", TAKE_RAW, True
)
NEGATIVE_LIGHT = Corruption(
    "negative light", "{}, and no light is negative: the photograph was sharpened", TAKE_RAW, True
)
SCATTER = Corruption(
    "scatter", "the edge scatters by {} more than the noise of its plains explains: it is rough or vibrated, or a filter "
    "smoothed the plains", "take a cut edge or a finer print, keep the camera still, and take the RAW file",
)  # fmt: skip
VEIL = Corruption(
    "veil", "light is scattered farther than the plains reach ({})",
    "keep stray light away, clean the lens, or give a wider region",
)  # fmt: skip


def threshold(places: int = 1) -> float:
    """Score beyond which a test fails that was made at so many places, of which the largest score counts."""
    return NormalDist().inv_cdf(1 - FALSE_ALARM / places)


def nuisance(estimate: float, uncertainty: float, prior: float) -> float:
    """Root mean square of a strength that is not negative, known to `estimate` with a standard uncertainty.

    The prior is half-normal of standard deviation `prior`; an infinite uncertainty leaves it as it is.
    """
    if not math.isfinite(uncertainty):
        return prior
    share = prior**2 / (prior**2 + uncertainty**2)
    mean, spread = estimate * share, uncertainty * math.sqrt(share)
    normal, at = NormalDist(), mean / spread
    if at < -8:  # far on the wrong side the posterior falls as an exponential of this length
        return math.sqrt(2) * spread / -at
    return math.sqrt(mean**2 + spread**2 + mean * spread * normal.pdf(at) / normal.cdf(at))
