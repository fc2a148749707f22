"""Combination of several shots of one chart: the PSF's mean weighted by covariances, and a test of agreement.

A shot's PSF has sum 1, so its covariance is singular along the direction in which all samples grow equally. With Q an
orthonormal basis of the other directions, a_i = Q' h_i and A_i = Q' C_i Q,

    a = (sum A_i^-1)^-1 sum A_i^-1 a_i,   C = Q (sum A_i^-1)^-1 Q',   chi^2 = sum (a_i - a)' A_i^-1 (a_i - a).

Nor does the covariance include the uncertainty of the centre by the marks. chi^2 therefore uses a basis that is
orthogonal to the PSF's shifts too, and the scatter of the centre from shot to shot is reported separately and added to
C.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaincc, ndtri

from procedures.choice import COMMON, TERMS, Budget, Trial, knot_budgets, with_parts
from procedures.numerics.arrays import Array
from procedures.numerics.warps import inverse
from procedures.outcome import Check, Outcome, Verdict, verdict_of, with_causes
from procedures.pattern_psf.error_parts import Variation
from procedures.pattern_psf.estimate import PatternPsf
from procedures.psf import Psf, PsfTail
from procedures.quality import Diffraction, Quality, assess

UNLIKELY, IMPOSSIBLE = 1e-4, 1e-12
"""p-values of chi^2 below which the result is doubtful, and below which it is refused."""
MAX_SPREAD = 0.03  # relative distance of a shot from the mean below which a disagreement is only doubtful
CENTRE_PX = 0.05  # scatter of the centre, in pixels, above which the result is doubtful


@dataclass(frozen=True, eq=False)
class CombinedPsf:
    """PSF of one plane from several shots.

    shots : estimates from the single shots, in order
    chi_square : chi^2 of the shots about their mean, per degree of freedom; near 1 where they agree within their
        uncertainties
    chance : p-value of chi^2
    spread : largest distance of a shot's PSF from the mean, over the norm of the mean
    centre_px : scatter of the centre from shot to shot, in pixels
    places : positions of these shots among all that were given: refused ones are excluded
    """

    psf: Psf
    shots: tuple[PatternPsf, ...]
    chi_square: float
    chance: float
    spread: float
    centre_px: float
    places: tuple[int, ...]

    @property
    def charts(self) -> tuple[PatternPsf, ...]:
        """Estimates from the single photographs."""
        return self.shots

    @cached_property
    def quality(self) -> Quality:
        """MTF and sharpness metrics of the mean; the terms `COMMON` of the budgets do not decrease with the number of
        shots."""
        first = self.shots[0].quality
        n = sum(shot.n for shot in self.shots)
        quality = assess(self.psf, n=n, diffraction=self.diffraction, at=first.at, origin=first.origin)
        of_shots = [{**knot_budgets(shot.quality), **shot.quality.budgets} for shot in self.shots]
        whole = {**knot_budgets(quality), **quality.budgets}
        parts = {
            name: _part_of_mean([one[name] for one in of_shots if name in one], terms["noise"])
            for name, terms in whole.items()
        }
        return with_parts(quality, parts)

    @property
    def diffraction(self) -> Diffraction | None:
        """Diffraction limit of the plane, where known."""
        return self.shots[0].diffraction

    @property
    def choice(self) -> tuple[Trial, ...]:
        """Trials of s and k on the first shot."""
        return self.shots[0].choice

    @property
    def variations(self) -> tuple[Variation, ...]:
        """MTF50 in the halves of the chart, from the first shot."""
        return self.shots[0].variations

    @property
    def diagnostics(self) -> Mapping[str, float]:
        """Means of the shots' diagnostics, and statistics of their agreement."""
        names = self.shots[0].diagnostics
        means = {name: float(np.mean([shot.diagnostics[name] for shot in self.shots])) for name in names}
        agreement = {"chi_square": self.chi_square, "chance": self.chance, "spread": self.spread}
        return {**means, **agreement, "centre_scatter_px": self.centre_px, "shots": float(len(self.shots))}

    @property
    def inter_image(self) -> None:
        """None: the inter-image PSF needs two photographs."""

    @property
    def values(self) -> dict[str, float]:
        """Means of the shots' numbers without an uncertainty, and statistics of their agreement."""
        each = [shot.values for shot in self.shots]
        means = {name: float(np.mean([one[name] for one in each])) for name in each[0]}
        return {**means, "chi_square": self.chi_square, "spread": self.spread}


def combine(outcomes: Sequence[Outcome[PatternPsf]]) -> Outcome[CombinedPsf]:
    """Combine the accepted shots of one plane; the verdict covers agreement and common flags. Source: least squares;
    GUM, annex H.5."""
    shots = [outcome.value for outcome in outcomes if outcome.value is not None]
    if not outcomes:
        return Outcome(None, Verdict.REFUSED, "no shot was taken", "take shots")
    if not shots:
        return outcomes[0].of_value(None)
    combined = _mean(shots, [i for i, outcome in enumerate(outcomes) if outcome.value is not None])
    agreement = verdict_of(_agreement(combined), combined)
    doubtful = [one for one in outcomes if one.verdict is Verdict.DOUBTFUL]
    return with_causes(agreement, doubtful[0]) if 2 * len(doubtful) > len(shots) else agreement


def _mean(shots: Sequence[PatternPsf], places: Sequence[int]) -> CombinedPsf:
    k = shots[0].psf.k
    n = k * k
    p = np.array([shot.psf.parameters for shot in shots])
    h = p[:, :n]
    C = [shot.psf.parameter_covariance for shot in shots]
    slope_y, slope_x = np.gradient(h.mean(axis=0).reshape(k, k))
    beyond = np.zeros((p.shape[1] - n, 2))  # a shift of the PSF does not move its far tail
    shifts = np.vstack([np.column_stack([slope_x.ravel(), slope_y.ravel()]), beyond])
    level = np.append(np.full(n, 1.0 / k), beyond[:, 0])[:, None]
    Q = _complement(level)
    a, covariance, _ = _weighted(p @ Q, [Q.T @ one @ Q for one in C])
    mean = level[:, 0] / k + Q @ a
    P = _complement(np.column_stack([level, shifts]))
    _, _, chi_square = _weighted(p @ P, [P.T @ one @ P for one in C])
    freedom = (len(shots) - 1) * P.shape[1]
    shift = np.linalg.lstsq(shifts[:n], (h - mean[:n]).T, rcond=None)[0]  # in samples
    scatter = np.cov(shift) if len(shots) > 1 else np.zeros((2, 2))
    covariance_with_centre = Q @ covariance @ Q.T + shifts @ (scatter / len(shots)) @ shifts.T
    tail = PsfTail(mean[n:], covariance_with_centre[n:, n:], covariance_with_centre[:n, n:])
    return CombinedPsf(
        psf=Psf(mean[:n].reshape(k, k), shots[0].psf.s, covariance_with_centre[:n, :n], tail),
        shots=tuple(shots),
        chi_square=chi_square / freedom if freedom else float("nan"),
        chance=float(gammaincc(freedom / 2, chi_square / 2)) if freedom else 1.0,
        spread=float(np.linalg.norm(h - mean[:n], axis=1).max() / np.linalg.norm(mean[:n])),
        centre_px=float(np.sqrt(np.trace(scatter))) / shots[0].psf.s,
        places=tuple(places),
    )


def _part_of_mean(budgets: Sequence[Budget], noise: float) -> Budget:
    """Terms of a number of the mean in the proportions of the shots' budgets; `noise` is by the mean's covariance."""
    if not budgets:
        return {"noise": noise}
    mean = {term: float(np.mean([budget[term] ** 2 for budget in budgets])) for term in TERMS}
    random = {term: mean[term] for term in TERMS if term not in (*COMMON, "choice")}
    total = sum(random.values())
    return {**{t: noise * (v / total) ** 0.5 for t, v in random.items()}, **{t: mean[t] ** 0.5 for t in COMMON}}


def _complement(columns: Array) -> Array:
    """Orthonormal basis (n, n - m) of the orthogonal complement of the columns (n, m)."""
    n, m = columns.shape
    return np.asarray(np.linalg.qr(columns, mode="complete")[0][:, m:n])


def _weighted(a: Array, A: Sequence[Array]) -> tuple[Array, Array, float]:
    """Mean of the rows of `a` weighted by the inverses of their covariances, its covariance, and chi^2 about it."""
    W = [inverse(one) for one in A]
    covariance = inverse(np.sum(W, axis=0))
    mean = covariance @ np.sum([w @ one for w, one in zip(W, a, strict=True)], axis=0)
    chi_square = sum(float((one - mean) @ w @ (one - mean)) for w, one in zip(W, a, strict=True))
    return mean, covariance, chi_square


def _agreement(combined: CombinedPsf) -> list[Check]:
    distances = [float(np.linalg.norm(shot.psf.h - combined.psf.h)) for shot in combined.shots]
    reason = (
        f"the shots disagree: chi-square is {combined.chi_square:.2f} per degree of freedom, and shot "
        f"{int(np.argmax(distances)) + 1} of {len(distances)} lies {combined.spread:.1%} from the mean"
    )
    return [
        Check("agreement", -ndtri(combined.chance), -ndtri(IMPOSSIBLE), Verdict.REFUSED, reason,
              "keep camera and chart still, and take the shots again", given=combined.spread > MAX_SPREAD),
        Check("agreement", -ndtri(combined.chance), -ndtri(UNLIKELY), Verdict.DOUBTFUL, reason,
              "keep light and focus unchanged, and take the shots again"),
        Check("centre", combined.centre_px, CENTRE_PX, Verdict.DOUBTFUL,
              f"the PSF's centre scatters by {combined.centre_px:.2f} px from shot to shot",
              "keep the marks free of reflections and shadows"),
    ]  # fmt: skip
