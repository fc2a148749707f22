"""How finely and how widely the PSF is sampled: s and k from the photograph, or what those that were given leave out.

s is raised until the OTF is zero at the band's edge within a few per cent: light beyond the band is missed by widths
and energies, and left over as noise. k is raised until what the tail's few shapes may miss of the OTF is small beside
its noise. What was photographed has an end too: no grid may ask for frequencies that it does not have.
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
"""The first try; another s keeps the support's width in pixels."""
WIDEST = 41
EQUATIONS = 8
"""Least samples per PSF value of a try that is not asked for."""
RIM, OPEN = 0.8, 0.05
"""The band is open where the OTF's root mean square over the frequencies beyond `RIM` of it exceeds `OPEN`."""
HALF = 0.5
"""Of a standard uncertainty: what may be left out without a doubt."""
MOST_TRIES = 4
WIDER = 1.6
"""By how much one try's support is wider than the last one's at the most: what is left out is known roughly."""

T = TypeVar("T")


@dataclass(frozen=True)
class Trial:
    """One try of s and k, and why it did or did not do.

    Attributes
    ----------
    s, k : int
    mtf50 : tuple of float or None
        Along x and along y, None where the MTF stays above one half.
    uncertainty : float
        Noise of the OTF, the mean of its standard uncertainties along x and y where the MTF is one half or at Nyquist.
    truncation : float
        What the support may leave out of the OTF.
    band_edge : float
        Root mean square of the OTF near the band's edge, without its noise.
    reason : str
    better : (int, int) or None
        The s and k that would leave out less; None where it does, or nothing better can be had.
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
        """Whether the support leaves out too much beside the noise."""
        return self.truncation > self.most_truncated

    @property
    def most_truncated(self) -> float:
        """The truncation above which the support is too short."""
        return HALF * float(np.hypot(self.truncation, self.uncertainty))

    @property
    def band_open(self) -> bool:
        """Whether the camera passes what s does not hold."""
        return self.band_edge > OPEN


def assess_trial(psf: Psf) -> Trial:
    """What a PSF says of its own s and k."""
    uncertainties, crossings, C = [], [], psf.parameter_covariance
    for angle in (0.0, np.pi / 2):
        found = mtf50_along(psf, angle)
        crossings.append(None if found is None else found[0])
        f = np.array([0.5 if found is None else min(found[0], 0.5)])
        waves = psf.spectra(f * np.cos(angle), f * np.sin(angle))
        value = complex((waves @ psf.parameters)[0]) / psf.light
        slope = (np.real(np.conj(value) / abs(value) * waves[0]) - abs(value) * psf.weights) / psf.light
        uncertainties.append(float(np.sqrt(max(slope @ C @ slope, 0.0))))
    pair = (crossings[0], crossings[1])
    return Trial(psf.s, psf.k, pair, float(np.mean(uncertainties)), truncation(psf), band_edge(psf))


def band_edge(psf: Psf) -> float:
    """Root mean square of the OTF over the ring beyond `RIM` of the band's half width, its noise taken away."""
    turn = np.arange(0, np.pi, np.pi / 12)
    f = psf.s / 2 * np.linspace(RIM, 1, 4)[:, None]
    waves = psf.spectra((f * np.cos(turn)).ravel(), (f * np.sin(turn)).ravel())
    power = np.abs(waves @ psf.parameters) ** 2
    C = psf.parameter_covariance
    noise = sum(np.einsum("ij,ij->i", part @ C, part) for part in (waves.real, waves.imag))
    return float(np.sqrt(max(float(np.mean(power - noise)), 0.0))) / psf.light


def _fitting(width_px: float, s: int, samples: int) -> int:
    """The odd k for a support of a width, as far as the samples determine it."""
    most = min(int((samples / EQUATIONS) ** 0.5), WIDEST)
    k = min(round(width_px * s), most)
    return max(k - 1 + k % 2, 5)


def judged(trial: Trial, samples: int, most_s: int, wider: float = WIDER) -> Trial:
    """The trial with what is said of it, and the s and k that would do better; `most_s` is the largest s there is.

    `wider` is by how much the support may widen at the most.
    """
    s, width = trial.s, trial.k / trial.s
    said = []
    if trial.band_open:
        s = min(s + 1, max(most_s, s))
        said.append(f"the OTF is {trial.band_edge:.2f} near the band's edge")
    if trial.support_short:
        # what is left out falls with the square of the width
        width *= float(np.clip(np.sqrt(trial.truncation / (HALF * trial.uncertainty)), 1.15, wider))
        said.append(f"the support may leave out {trial.truncation:.4f} of the OTF, known to {trial.uncertainty:.4f}")
    k = _fitting(width, s, samples)
    better = (s, k) if said and (s > trial.s or k > trial.k) else None
    return replace(trial, reason="; ".join(said) or "nothing left out that matters", better=better)


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
    """The result for the s and k that do, and what was tried.

    Parameters
    ----------
    attempt : callable
        From s and k to a result.
    psf_of : callable
        The PSF in a result.
    samples : int
        That the PSF is estimated from.
    most_s : int
        The largest s that what was photographed allows.
    start_s : int
        The first try.
    s, k : int or None
        What is given; None: chosen.
    """
    at = s or min(start_s, most_s, k or start_s)  # a support narrower than a pixel explains no photograph
    now = (at, k or _fitting(START_K / START_S, at, samples))
    tried: list[Trial] = []
    while True:
        try:
            result = attempt(*now)
        except (Refused, np.linalg.LinAlgError):
            if not tried:
                raise
            # finer or wider cannot be had
            why = f"{tried[-1].reason}; s = {now[0]}, k = {now[1]} is not determined"
            return result, (*tried[:-1], replace(tried[-1], reason=why, better=None))
        # what is given is not tried again: told is what would do at once
        trial = judged(assess_trial(psf_of(result)), samples, most_s, WIDER if k is None else np.inf)
        tried.append(trial)
        following = now if trial.better is None else (s or trial.better[0], k or trial.better[1])
        if following == now or len(tried) == MOST_TRIES:
            return result, tuple(tried)
        now = following


def settling(tried: tuple[Trial, ...]) -> float:
    """By what share MTF50 may still move when k is raised: its last move, which falls with the square of the width."""
    if len(tried) < 2:
        return 0.0
    before, last = tried[-2:]
    narrower = (before.k / before.s) / (last.k / last.s)
    moves = [abs(b / a - 1) for a, b in zip(before.mtf50, last.mtf50, strict=True) if a and b]
    return max(moves, default=0.0) * narrower**2 if narrower < 1 else 0.0
