"""Clipping seen in the samples themselves: they pile up at their own largest or smallest value.

A sensor, a converter or a program may cut light off anywhere below the nominal white, and black anywhere above 0. What
is cut off stands in one value where noise would spread it over several. A plain area without noise stands in one value
too: so there must be noise elsewhere, or an approach to the pile so abrupt that no lens makes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.ordered import distinct, quantile

Array = npt.NDArray[np.float64]

NOMINAL = 0.998
"""Samples from here on count as saturated: white is 1, and gain corrections leave a few steps of play."""
STRAY = 0.0005
"""Share of the samples, hot pixels and dust, that may lie beyond the pile."""
LEAST_PILE = 0.005
"""Share of the samples from which on they are a pile."""
FEWEST = 6
"""Samples that make a pile: of few, as a small chart's white blocks have, two are alike by chance."""
STEEP = 2.0
"""How many times as many samples a pile holds as the values beside it: on the flank of noise they become more."""
SOME_NOISE, MUCH_NOISE = 0.3, 2.0
"""Noise in steps of the numbers, on the dark side, that spreads the brighter one over several values, as light is never
less noisy where there is more of it; and on the bright side, that the darker one cannot be without."""
NEAR, FAR = 0.005, 0.05
"""Of the contrast: the approach to an end is looked at between these distances."""
LOW = 0.02
"""Quantile of the samples that stands for the other end."""
ABRUPT = 0.55
"""Samples on the approach to a pile, over those on the approach to the other end, under which it was cut off."""
LOOKED_AT = 200_000
"""Samples that are looked at to see in which steps they come."""


@dataclass(frozen=True)
class Clipping:
    """Shares of the samples that are cut off: `black` at their smallest value, `white` at their largest."""

    black: float
    white: float


def find_clipping(
    samples: npt.NDArray[np.float32] | Array,
    quantisation: float = 0.0,
    *,
    dark_noise: float = 0.0,
    bright_noise: float = 0.0,
    of_edge: bool = False,
) -> Clipping:
    """The shares of samples that pile up at their own ends, and at the nominal white.

    Parameters
    ----------
    samples : of any shape, black 0 and nominal white 1
    quantisation : float
        One digital number in these units; where samples come in larger steps, that is seen.
    dark_noise, bright_noise : float
        Standard deviations of the noise where it is dark and where it is bright, in these units; 0 where they are not
        known.
    of_edge : bool
        Whether the samples are of one edge between two plains: its approach to both is then compared too.
    """
    values = np.ravel(samples).astype(np.float64)
    values = values[np.isfinite(values)]
    if not len(values):
        return Clipping(0.0, 0.0)
    step = _step(values, quantisation)
    nominal = float(np.mean(values >= NOMINAL))
    white = _cut_off(values, step, dark_noise, SOME_NOISE, of_edge)
    black = _cut_off(-values, step, bright_noise, MUCH_NOISE, of_edge)
    return Clipping(black, max(white, nominal))


def _step(values: Array, quantisation: float) -> float:
    """The distance of neighbouring values: more than `quantisation` where few bits became many."""
    levels = distinct(values[:: max(1, len(values) // LOOKED_AT)])
    return max(quantisation, quantile(np.diff(levels), 0.1) if len(levels) > 1 else 0.0)


def _cut_off(values: Array, step: float, noise: float, enough: float, of_edge: bool) -> float:
    """The share of values that are cut off at the upper end; the other end has a noise."""
    stray = int(STRAY * len(values))
    pile = float(np.partition(values, len(values) - 1 - stray)[len(values) - 1 - stray])
    top = values[values > pile - 4 * step]
    counts = [np.count_nonzero(np.abs(top - pile + i * step) < step / 2) for i in range(4)]
    share = counts[0] / len(values)
    if share < LEAST_PILE or counts[0] < FEWEST or counts[0] < STEEP * max(counts[1:]):
        return 0.0
    cut = noise > enough * step or (of_edge and _abrupt(values, pile, max(2.5 * step, 4 * noise)))
    return share if cut else 0.0


def _abrupt(values: Array, pile: float, fuzzy: float) -> bool:
    """Whether far fewer values lie on the approach to the upper end than on that to the lower one, fuzzy by so much."""
    low = quantile(values, LOW)
    near = max(NEAR * (pile - low), fuzzy)
    far = near + (FAR - NEAR) * (pile - low)
    above, below = (
        np.count_nonzero((distance > near) & (distance < far)) for distance in (pile - values, values - low)
    )
    return bool(above < ABRUPT * below)
