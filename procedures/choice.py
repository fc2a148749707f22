"""Automatic choice of the sampling s and the support k, and assessment of given ones.

s is raised until the OTF at the band's edge is zero within a few per cent: energy beyond the band is missing in widths
and energies, and remains as noise in the residual. k is raised until the truncation of the OTF is small compared with
its noise. The subject limits s: the grid must not have frequencies that the subject lacks.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from procedures.numbers import LEVELS, MTF_CROSSINGS, MTF_NYQUIST, frequency_of, name_at
from procedures.numerics.arrays import Array
from procedures.outcome import Refused
from procedures.psf import Psf, cut_off, truncation
from procedures.quality import KNOTS, PRINT_BLUR, Quality, assess, mtf50_along

FINEST = 6
START_S, START_K = 4, 17  # first trial; another s keeps the support's width in pixels
MAX_K = 41
MIN_SAMPLES_PER_VALUE = 8  # least number of samples per PSF value of an automatic trial
RIM, OPEN = 0.8, 0.05
"""The band is open where the OTF's root mean square over the frequencies beyond `RIM` of it exceeds `OPEN`."""
MAX_TRUNCATION_SIGMAS = 0.5  # greatest truncation that is accepted, in combined standard uncertainties
MAX_TRIALS = 4
MAX_WIDENING = 1.6  # greatest ratio of successive widths of the support, as the truncation is known only roughly
CUT_OFF_WIDENING = 1.3  # of the support where it cuts off the PSF's own shape, which ends faster than a tail

T = TypeVar("T")


@dataclass(frozen=True)
class Trial:
    """Trial of s and k, with its assessment.

    mtf50 : along x and along y, None where the MTF stays above one half
    uncertainty : noise of the OTF, the mean of its standard uncertainties along x and y where the MTF is one half or at
        Nyquist
    truncation : part of the OTF that the support may truncate
    band_edge : rms of the OTF near the band's edge, corrected for noise
    cut_off : share of the energy that the support may cut off: see `psf.cut_off`
    better : (int, int) or None; better s and k; None where these suffice, or none are possible
    """

    s: int
    k: int
    mtf50: tuple[float | None, float | None]
    uncertainty: float
    truncation: float
    band_edge: float
    reason: str = ""
    better: tuple[int, int] | None = None
    cut_off: float = 0.0

    @property
    def support_short(self) -> bool:
        """Whether the truncation is too large compared with the noise."""
        return self.truncation > self.most_truncated

    @property
    def most_truncated(self) -> float:
        """Greatest acceptable truncation."""
        return MAX_TRUNCATION_SIGMAS * float(np.hypot(self.truncation, self.uncertainty))

    @property
    def cuts_off(self) -> bool:
        """Whether the support is too small for the PSF's own shape alone."""
        limit = MAX_TRUNCATION_SIGMAS * float(np.hypot(self.cut_off, self.uncertainty))
        return self.cut_off > limit and not self.support_short and not self.band_open

    @property
    def band_open(self) -> bool:
        """Whether the OTF extends beyond the band of s."""
        return self.band_edge > OPEN


def assess_trial(psf: Psf) -> Trial:
    """Assess s and k of a PSF."""
    uncertainties, crossings, C = [], [], psf.parameter_covariance
    for angle in (0.0, np.pi / 2):
        mtf50 = mtf50_along(psf, angle)
        crossings.append(None if mtf50 is None else mtf50[0])
        f = np.array([0.5 if mtf50 is None else min(mtf50[0], 0.5)])
        waves = psf.spectra(f * np.cos(angle), f * np.sin(angle))
        value = complex((waves @ psf.parameters)[0]) / psf.light
        slope = (np.real(np.conj(value) / abs(value) * waves[0]) - abs(value) * psf.weights) / psf.light
        uncertainties.append(float(np.sqrt(max(slope @ C @ slope, 0.0))))
    pair, noise = (crossings[0], crossings[1]), float(np.mean(uncertainties))
    return Trial(psf.s, psf.k, pair, noise, truncation(psf), band_edge(psf), cut_off=cut_off(psf))


def band_edge(psf: Psf) -> float:
    """Rms of the OTF over the ring beyond `RIM` of the band's half width, corrected for noise."""
    turn = np.arange(0, np.pi, np.pi / 12)
    f = psf.s / 2 * np.linspace(RIM, 1, 4)[:, None]
    waves = psf.spectra((f * np.cos(turn)).ravel(), (f * np.sin(turn)).ravel())
    power = np.abs(waves @ psf.parameters) ** 2
    C = psf.parameter_covariance
    noise = sum(np.einsum("ij,ij->i", part @ C, part) for part in (waves.real, waves.imag))
    return float(np.sqrt(max(float(np.mean(power - noise)), 0.0))) / psf.light


def _fitting(width_px: float, s: int, samples: int) -> int:
    """Odd k for a width of the support, limited by the number of samples."""
    most = min(int((samples / MIN_SAMPLES_PER_VALUE) ** 0.5), MAX_K)
    k = min(round(width_px * s), most)
    return max(k - 1 + k % 2, 5)


def with_advice(trial: Trial, samples: int, most_s: int, wider: float = MAX_WIDENING) -> Trial:
    """Add the reason and better s and k to a trial; `most_s` is the largest s, `wider` the largest ratio of widths."""
    s, width = trial.s, trial.k / trial.s
    reasons = []
    if trial.band_open:
        s = min(s + 1, max(most_s, s))
        reasons.append(f"the OTF is {trial.band_edge:.2f} near the band's edge")
    if trial.support_short:
        # the truncation falls with the square of the width
        width *= float(np.clip(np.sqrt(trial.truncation / (MAX_TRUNCATION_SIGMAS * trial.uncertainty)), 1.15, wider))
        reasons.append(f"k may truncate {trial.truncation:.4f} of the OTF, with uncertainty {trial.uncertainty:.4f}")
    elif trial.cuts_off:
        width *= CUT_OFF_WIDENING
        reasons.append(f"k may cut off {trial.cut_off:.4f} of the light")
    k = _fitting(width, s, samples)
    better = (s, k) if reasons and (s > trial.s or k > trial.k) else None
    return replace(trial, reason="; ".join(reasons) or "the sampling suffices", better=better)


def choose(
    attempt: Callable[[int, int], T], psf_of: Callable[[T], Psf], samples: int, most_s: int, *,
    start_s: int = START_S, s: int | None, k: int | None,
) -> tuple[T, tuple[Trial, ...]]:  # fmt: skip
    """Choose s and k; returns the result and the trials.

    attempt : function from s and k to a result
    psf_of : function from a result to its PSF
    samples : number of samples of the estimate
    most_s : largest s that the subject allows
    start_s : s of the first trial
    s, k : given values; None: chosen
    """
    at = s or min(start_s, most_s, k or start_s)  # the support must be at least a pixel wide
    current = (at, k or _fitting(START_K / START_S, at, samples))
    trials: list[Trial] = []
    results: list[T] = []
    while True:
        try:
            result = attempt(*current)
        except (Refused, np.linalg.LinAlgError):
            if not trials:
                raise
            # a finer or wider grid is not possible
            why = f"{trials[-1].reason}; s = {current[0]}, k = {current[1]} is not determined"
            return results[-1], (*trials[:-1], replace(trials[-1], reason=why, better=None))
        # given values are not changed: the report names a k that suffices at once
        trial = with_advice(assess_trial(psf_of(result)), samples, most_s, MAX_WIDENING if k is None else np.inf)
        if trials and trials[-1].cuts_off and trial.cut_off > trials[-1].cut_off:  # it is not the PSF's own shape
            return results[-1], (*trials[:-1], replace(trials[-1], better=None))
        trials.append(trial)
        following = current if trial.better is None else (s or trial.better[0], k or trial.better[1])
        if following == current or len(trials) == MAX_TRIALS:
            return result, tuple(trials)
        current = following
        results.append(result)


def remaining_change(trials: tuple[Trial, ...]) -> float:
    """Expected relative change of MTF50 if k is raised: its last change, which falls with the square of the width."""
    if len(trials) < 2:
        return 0.0
    before, last = trials[-2:]
    narrower = (before.k / before.s) / (last.k / last.s)
    changes = [abs(b / a - 1) for a, b in zip(before.mtf50, last.mtf50, strict=True) if a and b]
    return max(changes, default=0.0) * narrower**2 if narrower < 1 else 0.0


# --- Uncertainty budgets: contributions of the sources to the uncertainty of a number ---
# Every term is a standard uncertainty in the unit of the number. The terms are independent; the root of the sum of
# their squares is the combined uncertainty. Source: ISO/IEC Guide 98-3 (GUM), section 5.1 and annex H.

Budget = Mapping[str, float]  # terms by name, each a standard uncertainty

TERMS = {
    "noise": "noise of the samples",
    "light": "light and response",
    "sensor": "the sensor's response, as calibrated",
    "geometry": "geometry",
    "print": "printed edges",
    "tail": "energy outside the support",
    "mismatch": "model error in the residual",
    "processing": "sharpening or denoising not excluded",
    "wide mask": "wide mask not excluded",
    "ghost": "ghost not excluded",
    "variation": "variation of the PSF over the chart",
    "print blur": "blur of the print",
    "focus": "focus at either distance",
    "choice": "choice of s and k",
}
"""Descriptions of the terms, in the order of reports."""
UNSEEN = ("processing", "wide mask", "ghost", "variation", PRINT_BLUR)
"""Terms by corruptions that a photograph does not exclude."""
COMMON = ("mismatch", *UNSEEN)  # terms that may be common to all photographs of one chart by one camera
FREQUENCIES = tuple(f"mtf{level}_" for level in LEVELS)  # prefixes of the numbers that are frequencies


def combined(budget: Budget) -> float:
    """Combined standard uncertainty."""
    return float(sum(term**2 for term in budget.values()) ** 0.5)


def with_parts(quality: Quality, parts: Mapping[str, Budget]) -> Quality:
    """Replace the uncertainties of numbers and curves by those of the parts, at KNOTS for the curves; keep the term
    "choice"."""
    budgets = {}
    for name, terms_before in quality.budgets.items():
        terms = {**parts.get(name, terms_before)}
        terms["choice"] = terms_before["choice"]
        budgets[name] = {term: terms.get(term, 0.0) for term in TERMS}
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    curves = {name: _curve_budget(quality, name, parts) for name in quality.curve_budgets}
    return replace(quality, numbers=numbers, budgets=budgets, curve_budgets=curves)


def knot_budgets(quality: Quality) -> dict[str, Budget]:
    """Budgets of the curves at the frequencies `KNOTS`, by the names of the MTF there."""
    return {
        name_at(quality.frequencies[i], direction): {term: float(curve[i]) for term, curve in terms.items()}
        for direction, terms in quality.curve_budgets.items()
        for i in range(len(quality.frequencies))[KNOTS]
    }


def _curve_budget(quality: Quality, direction: str, parts: Mapping[str, Budget]) -> dict[str, Array]:
    """Terms of a curve: its noise times the terms over the noise, interpolated between the knots."""
    before = quality.curve_budgets[direction]
    f, noise = quality.frequencies[KNOTS], np.maximum(before["noise"][KNOTS], 1e-300)
    terms = [parts.get(name_at(one, direction), {"noise": u}) for one, u in zip(f, noise, strict=True)]
    curve = {
        term: before["noise"] * np.interp(quality.frequencies, f, [one.get(term, 0.0) for one in terms] / noise)
        for term in TERMS
        if term != "choice"
    }
    return {**curve, "choice": before["choice"]}


def with_modes(quality: Quality, psf: Psf, modes: Mapping[str, Array]) -> Quality:
    """Add uncertain changes of the transfer function as terms of the budgets: modes are one standard deviation,
    relative, at `quality.frequencies`, alike in all directions."""
    budgets = {name: {**terms} for name, terms in quality.budgets.items()}
    of_curves = {name: {**terms} for name, terms in quality.curve_budgets.items()}
    curves = {way: getattr(quality, f"mtf_{way}") for way in of_curves}
    for term, change in modes.items():
        # change (k^2,) of a PSF's samples by a relative change of its transfer function at frequencies f
        image = psf.extended()
        grid = np.hypot(*np.meshgrid(*(fft(len(image)) * psf.s for fft in (np.fft.rfftfreq, np.fft.fftfreq))))
        filtered = np.fft.irfft2(np.fft.rfft2(image) * np.interp(grid, quality.frequencies, change), image.shape)
        rim = (len(image) - psf.k) // 2
        moved = np.asarray(filtered[rim : rim + psf.k, rim : rim + psf.k].ravel())
        for way, mtf in curves.items():
            of_curves[way][term] = np.hypot(of_curves[way].get(term, 0.0), mtf * change)
        for name, terms in budgets.items():
            terms[term] = math.hypot(terms.get(term, 0.0), _change_of(name, quality, curves, change, moved))
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    return replace(quality, numbers=numbers, budgets=budgets, curve_budgets=of_curves)


def unseen_change(quality: Quality, f: Array) -> Array:
    """Relative standard uncertainty (n,) of the transfer function at frequencies f by the corruptions that a photograph
    does not exclude; a field shares it at all places."""
    terms = quality.curve_budgets["radial"]
    size = np.sqrt(sum((terms[term] ** 2 for term in UNSEEN if term in terms), np.zeros(1)))
    relative = size / np.maximum(quality.mtf_radial, 1e-9)
    return np.asarray(np.interp(f, quality.frequencies, np.broadcast_to(relative, quality.frequencies.shape)))


def _change_of(name: str, quality: Quality, curves: Mapping[str, Array], change: Array, moved: Array) -> float:
    """Change of a number by a relative change of the transfer function, or by that of the samples."""
    f = quality.frequencies
    for (level, way), crossed in MTF_CROSSINGS.items():
        if crossed == name:
            at, slope = quality.numbers[name].value, np.gradient(curves[way], f)
            return level / 100 * float(np.interp(at, f, change) / min(np.interp(at, f, slope), -1e-9))
    nyquist: dict[str, tuple[float, str]] = {number: (0.5, way) for way, number in MTF_NYQUIST.items()}
    if (at_frequency := nyquist.get(name) or frequency_of(name)) is not None:
        frequency, way = at_frequency
        return float(np.interp(frequency, f, curves[way] * change))
    return float(quality.gradients[name][: len(moved)] @ moved)


def with_frequencies(quality: Quality, psf: Psf, at: Sequence[float]) -> Quality:
    """Add the MTF at further frequencies, in cycles per pixel of the plane, with the budgets of the curves."""
    n = next((one.n for one in quality.numbers.values()), 0)
    fresh = assess(psf, n=n, at=at)
    numbers, budgets = dict(quality.numbers), dict(quality.budgets)
    for name, number in fresh.numbers.items():
        if (frequency := frequency_of(name)) is None or name in numbers:
            continue
        terms = quality.curve_budgets[frequency[1]].items()
        budgets[name] = {term: float(np.interp(frequency[0], quality.frequencies, curve)) for term, curve in terms}
        numbers[name] = replace(number, uncertainty=combined(budgets[name]))
    return replace(quality, numbers=numbers, budgets=budgets, at=tuple(at))
