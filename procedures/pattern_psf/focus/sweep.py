"""Where a sweep of the focus is sharpest, with an error bar, and which way to turn from here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

NEAR_TOP = 0.75
"""The parabola is laid through the widths of scores that are at least this share of the best: no lens keeps to it
further off."""
FEWEST = 3
SURE = 2.0
"""Standard uncertainties of a difference from which on it is one."""
AS_GOOD = 0.02
"""What is within this share of the best is as good as it, whatever the error bars."""


@dataclass(frozen=True)
class Peak:
    """The top of a sweep.

    Attributes
    ----------
    place, place_uncertainty : where, in the unit of the places
    score, score_uncertainty : how sharp it is there
    inside : whether it lies between the places that were tried
    n : of scores the parabola was laid through
    """

    place: float
    place_uncertainty: float
    score: float
    score_uncertainty: float
    inside: bool
    n: int


def best_focus(places: Sequence[float], scores: Sequence[float], uncertainties: Sequence[float]) -> Peak | None:
    """The top of a sweep by the scores near the best; None where they have no top yet.

    What is as a parabola about the focus is 1 / MTF50, a width: the MTF50 itself bends away from one on both sides,
    and the top of one through it lies up to 2 % too low (`tests/benchmarks/live_focus.py`). Weighted least squares of
    a + b u + c u^2; where the widths stray from it by more than their uncertainties, these are enlarged to what is
    seen. The least is at u = -b / 2 c, and is a - b^2 / 4 c; their variances are those of the coefficients, propagated
    linearly.

    Parameters
    ----------
    places : (n,) settings of the focus, in any order; NaN where they are not known
    scores : (n,) larger is sharper, above 0; NaN where none could be told
    uncertainties : (n,) standard ones, above 0
    """
    x, y, u = (np.asarray(values, dtype=np.float64) for values in (places, scores, uncertainties))
    known = np.isfinite(x) & np.isfinite(u) & (y > 0)
    x, y, u = x[known], y[known], u[known]
    if len(np.unique(x)) < FEWEST:
        return None
    top = int(np.argmax(y))
    near = y >= NEAR_TOP * y[top]
    if len(np.unique(x[near])) < FEWEST:
        near = _neighbours(x, top)
    c, C = _parabola(x[near] - x[top], 1 / y[near], u[near] / y[near] ** 2)
    if c[2] <= 0 or c[0] <= c[1] ** 2 / (4 * c[2]):
        return None
    at = -c[1] / (2 * c[2])
    width = float(c[0] + c[1] * at / 2)
    of_place = np.array([0.0, -1 / (2 * c[2]), c[1] / (2 * c[2] ** 2)])
    of_width = np.array([1.0, at, at * at])
    place = float(x[top] + at)
    return Peak(
        place,
        float(np.sqrt(of_place @ C @ of_place)),
        1 / width,
        float(np.sqrt(of_width @ C @ of_width)) / width**2,
        bool(x.min() <= place <= x.max()),
        int(np.count_nonzero(near)),
    )


def _neighbours(x: Array, top: int) -> npt.NDArray[np.bool_]:
    """The three places nearest to the best, itself among them."""
    places = np.unique(x)
    nearest = places[np.argsort(np.abs(places - x[top]), kind="stable")[:FEWEST]]
    return np.isin(x, nearest)


def _parabola(x: Array, y: Array, u: Array) -> tuple[Array, Array]:
    """Coefficients (3,) of 1, x, x^2, and their covariance."""
    A = np.vander(x, 3, increasing=True) / u[:, None]
    C = np.linalg.inv(A.T @ A)
    c = C @ A.T @ (y / u)
    free = len(x) - 3
    strays = float(np.sum((A @ c - y / u) ** 2)) / free if free else 1.0
    return c, np.asarray(C * max(strays, 1.0), dtype=np.float64)


class Way(StrEnum):
    """Which way to turn the focus ring."""

    TRY = "either way"
    ON = "the same way"
    BACK = "back"
    STAY = "not at all"


@dataclass(frozen=True)
class Turn:
    """What to do with the focus ring: which way, and the sentence."""

    way: Way
    say: str


def which_way(scores: Sequence[float], uncertainties: Sequence[float], places: Sequence[float] = ()) -> Turn:
    """What to do with the focus ring after the last of these frames, which were taken one after the other.

    Parameters
    ----------
    scores : (n,) sharpness, NaN where none could be told
    uncertainties : (n,)
    places : (n,) settings of the focus, in steps towards infinity, where they are known; else as many steps were made
        as frames taken, all the same way
    """
    y, u = np.asarray(scores, dtype=np.float64), np.asarray(uncertainties, dtype=np.float64)
    if not np.isfinite(y).any():
        return Turn(Way.TRY, "Focus by eye first.")
    if not np.isfinite(y[-1]):
        return Turn(Way.BACK, "Turn back: this frame cannot be told.")
    known = np.flatnonzero(np.isfinite(y))
    if len(known) == 1:
        return Turn(Way.TRY, "Turn the ring a little, either way.")
    best, last, before = known[np.argmax(y[known])], known[-1], known[-2]
    if _falls(y, u, best, last):
        back = _steps_back(places, int(best), int(last))
        return Turn(Way.BACK, f"Turn {back}: frame {best + 1} was sharper, {y[best]:.3f}.")
    if _falls(y, u, last, before):
        return Turn(Way.ON, "Sharper: go on the same way.")
    if best != known[0] and _falls(y, u, best, known[0]):
        return Turn(Way.STAY, "Stay: this is as sharp as the best.")
    return Turn(Way.ON, "No difference yet: turn further.")


def _steps_back(places: Sequence[float], best: int, last: int) -> str:
    """How to come from one frame's setting to the best one's: "back 2 steps", "2 steps towards near"."""
    steps = places[best] - places[last] if len(places) > last else np.nan
    count = abs(steps) if np.isfinite(steps) else float(last - best)
    words = f"{count:g} step{'s' * (count != 1)}"
    return f"{words} towards {'infinity' if steps > 0 else 'near'}" if np.isfinite(steps) else f"back {words}"


def _falls(y: Array, u: Array, high: int, low: int) -> bool:
    """Whether one frame is surely less sharp than another."""
    least = max(SURE * float(np.hypot(u[high], u[low])), AS_GOOD * float(y[high]))
    return bool(y[high] - y[low] > least)
