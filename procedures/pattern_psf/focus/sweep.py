"""Best focus of a sweep with its uncertainty, and the direction in which to turn the ring next."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from procedures.numerics.arrays import Array

MIN_FIT_SCORE = 0.75
"""Least score, relative to the best, of the points fitted: farther from the focus no lens follows a parabola."""
MIN_POINTS = 3
SIGNIFICANCE = 2.0  # standard uncertainties above which a difference is significant
EQUAL_SHARE = 0.02  # relative difference from the best that is always treated as equal


@dataclass(frozen=True)
class Peak:
    """Best focus of a sweep.

    place, place_uncertainty : position, in the unit of the places
    score, score_uncertainty : sharpness there
    inside : whether it lies within the range of the places
    n : number of scores that the parabola was fitted to
    """

    place: float
    place_uncertainty: float
    score: float
    score_uncertainty: float
    inside: bool
    n: int


def best_focus(places: Sequence[float], scores: Sequence[float], uncertainties: Sequence[float]) -> Peak | None:
    """Best focus from a parabola through the scores near the best; None where they have no maximum.

    The parabola a + b u + c u^2 is fitted to the widths 1 / MTF50 by weighted least squares. MTF50 itself departs from
    a parabola on both sides of the focus, and the vertex of a parabola through it is up to 2 % too low
    (`tests/benchmarks/live_focus.py`). Where the residuals exceed the uncertainties, these are enlarged to match. The
    vertex is at u = -b / 2 c with the width a - b^2 / 4 c; the variances of the coefficients are propagated linearly.

    places : (n,) settings of the focus, in any order; NaN where they are not known
    scores : (n,) larger is sharper, above 0; NaN where not measured
    uncertainties : (n,) standard uncertainties, above 0
    """
    x, y, u = (np.asarray(values, dtype=np.float64) for values in (places, scores, uncertainties))
    known = np.isfinite(x) & np.isfinite(u) & (y > 0)
    x, y, u = x[known], y[known], u[known]
    if len(np.unique(x)) < MIN_POINTS:
        return None
    top = int(np.argmax(y))
    near = y >= MIN_FIT_SCORE * y[top]
    if len(np.unique(x[near])) < MIN_POINTS:
        each = np.unique(x)
        near = np.isin(x, each[np.argsort(np.abs(each - x[top]), kind="stable")[:MIN_POINTS]])
    c, C = _parabola(x[near] - x[top], 1 / y[near], u[near] / y[near] ** 2)
    if c[2] <= 0 or c[0] <= c[1] ** 2 / (4 * c[2]):
        return None
    at = -c[1] / (2 * c[2])
    width = float(c[0] + c[1] * at / 2)
    place_slopes = np.array([0.0, -1 / (2 * c[2]), c[1] / (2 * c[2] ** 2)])
    width_slopes = np.array([1.0, at, at * at])
    place = float(x[top] + at)
    return Peak(
        place,
        float(np.sqrt(place_slopes @ C @ place_slopes)),
        1 / width,
        float(np.sqrt(width_slopes @ C @ width_slopes)) / width**2,
        bool(x.min() <= place <= x.max()),
        int(np.count_nonzero(near)),
    )


def _parabola(x: Array, y: Array, u: Array) -> tuple[Array, Array]:
    """Coefficients (3,) of 1, x, x^2, and their covariance."""
    A = np.vander(x, 3, increasing=True) / u[:, None]
    C = np.linalg.inv(A.T @ A)
    c = C @ A.T @ (y / u)
    free = len(x) - 3
    excess = float(np.sum((A @ c - y / u) ** 2)) / free if free else 1.0
    return c, np.asarray(C * max(excess, 1.0), dtype=np.float64)


class TurnDirection(StrEnum):
    """Direction in which to turn the focus ring."""

    TRY = "either way"
    ON = "the same way"
    BACK = "back"
    STAY = "not at all"


@dataclass(frozen=True)
class Turn:
    """Advice on the focus ring: direction and sentence."""

    way: TurnDirection
    say: str


def advise_turn(scores: Sequence[float], uncertainties: Sequence[float], places: Sequence[float] = ()) -> Turn:
    """Advise on the focus ring after the last of a sequence of frames.

    scores : (n,) sharpness, NaN where not measured
    uncertainties : (n,)
    places : (n,) settings of the focus, in steps towards infinity, where known; else one step per frame is assumed
    """
    y, u = np.asarray(scores, dtype=np.float64), np.asarray(uncertainties, dtype=np.float64)
    if not np.isfinite(y).any():
        return Turn(TurnDirection.TRY, "Focus by eye first.")
    if not np.isfinite(y[-1]):
        return Turn(TurnDirection.BACK, "Turn back: the sharpness of this frame cannot be measured.")
    known = np.flatnonzero(np.isfinite(y))
    if len(known) == 1:
        return Turn(TurnDirection.TRY, "Turn the ring a little, either way.")
    best, last, before = known[np.argmax(y[known])], known[-1], known[-2]
    if _is_worse(y, u, best, last):
        back = _steps_back(places, int(best), int(last))
        return Turn(TurnDirection.BACK, f"Turn {back}: frame {best + 1} was sharper, {y[best]:.3f}.")
    if _is_worse(y, u, last, before):
        return Turn(TurnDirection.ON, "Sharper: go on the same way.")
    if best != known[0] and _is_worse(y, u, best, known[0]):
        return Turn(TurnDirection.STAY, "Stay: this is as sharp as the best.")
    return Turn(TurnDirection.ON, "No difference yet: turn further.")


def _steps_back(places: Sequence[float], best: int, last: int) -> str:
    """Steps from the last frame's setting to the best one's: "back 2 steps", "2 steps towards near"."""
    steps = places[best] - places[last] if len(places) > last else np.nan
    count = abs(steps) if np.isfinite(steps) else float(last - best)
    words = f"{count:g} step{'s' * (count != 1)}"
    return f"{words} towards {'infinity' if steps > 0 else 'near'}" if np.isfinite(steps) else f"back {words}"


def _is_worse(y: Array, u: Array, high: int, low: int) -> bool:
    least = max(SIGNIFICANCE * float(np.hypot(u[high], u[low])), EQUAL_SHARE * float(y[high]))
    return bool(y[high] - y[low] > least)
