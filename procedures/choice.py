"""Automatic choice of the sampling s and the support k, and assessment of given ones.

s is raised until the OTF at the band's edge is zero within a few per cent: energy beyond the band is missing in widths
and energies, and remains as noise in the residual. k is raised until the truncation of the OTF is small compared with
its noise. The subject limits s: the grid must not have frequencies that the subject lacks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from procedures.outcome import Refused
from procedures.psf import Psf
from procedures.quality import mtf50_along
from procedures.stray_tail import truncation

FINEST = 6
START_S, START_K = 4, 17
"""First trial; another s keeps the support's width in pixels."""
MAX_K = 41
MIN_SAMPLES_PER_VALUE = 8
"""Least number of samples per PSF value of an automatic trial."""
RIM, OPEN = 0.8, 0.05
"""The band is open where the OTF's root mean square over the frequencies beyond `RIM` of it exceeds `OPEN`."""
MAX_TRUNCATION_SIGMAS = 0.5
"""Greatest truncation that is accepted, in combined standard uncertainties."""
MAX_TRIALS = 4
MAX_WIDENING = 1.6
"""Greatest ratio of successive widths of the support, as the truncation is known only roughly."""

T = TypeVar("T")


@dataclass(frozen=True)
class Trial:
    """Trial of s and k, with its assessment.

    mtf50 : along x and along y, None where the MTF stays above one half
    uncertainty : noise of the OTF, the mean of its standard uncertainties along x and y where the MTF is one half or at
        Nyquist
    truncation : part of the OTF that the support may truncate
    band_edge : rms of the OTF near the band's edge, corrected for noise
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

    @property
    def support_short(self) -> bool:
        """Whether the truncation is too large compared with the noise."""
        return self.truncation > self.most_truncated

    @property
    def most_truncated(self) -> float:
        """Greatest acceptable truncation."""
        return MAX_TRUNCATION_SIGMAS * float(np.hypot(self.truncation, self.uncertainty))

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
    pair = (crossings[0], crossings[1])
    return Trial(psf.s, psf.k, pair, float(np.mean(uncertainties)), truncation(psf), band_edge(psf))


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
    k = _fitting(width, s, samples)
    better = (s, k) if reasons and (s > trial.s or k > trial.k) else None
    return replace(trial, reason="; ".join(reasons) or "the sampling suffices", better=better)


def choose(
    attempt: Callable[[int, int], T],
    psf_of: Callable[[T], Psf],
    samples: int,
    most_s: int,
    *,
    start_s: int = START_S,
    s: int | None,
    k: int | None,
) -> tuple[T, tuple[Trial, ...]]:
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
    while True:
        try:
            result = attempt(*current)
        except (Refused, np.linalg.LinAlgError):
            if not trials:
                raise
            # a finer or wider grid is not possible
            why = f"{trials[-1].reason}; s = {current[0]}, k = {current[1]} is not determined"
            return result, (*trials[:-1], replace(trials[-1], reason=why, better=None))
        # given values are not changed: the report names a k that suffices at once
        trial = with_advice(assess_trial(psf_of(result)), samples, most_s, MAX_WIDENING if k is None else np.inf)
        trials.append(trial)
        following = current if trial.better is None else (s or trial.better[0], k or trial.better[1])
        if following == current or len(trials) == MAX_TRIALS:
            return result, tuple(trials)
        current = following


def remaining_change(trials: tuple[Trial, ...]) -> float:
    """Expected relative change of MTF50 if k is raised: its last change, which falls with the square of the width."""
    if len(trials) < 2:
        return 0.0
    before, last = trials[-2:]
    narrower = (before.k / before.s) / (last.k / last.s)
    changes = [abs(b / a - 1) for a, b in zip(before.mtf50, last.mtf50, strict=True) if a and b]
    return max(changes, default=0.0) * narrower**2 if narrower < 1 else 0.0
