"""Stability of repeated PSFs of one camera: the relative sensitivity s(Omega) of the MTF over regions of frequencies.

Of n PSFs the MTF has a mean and a standard deviation at each frequency of the plane;

    s(Omega) = mean of the standard deviation over Omega / mean of the MTF over Omega,   Omega(t) = {f : MTF(f) >= t}

(thesis, Figure 2.17). The stable domain is the largest Omega(t) whose sensitivity does not exceed a limit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.numbers import SENSITIVITY, SENSITIVITY_AT_5, STABLE_HORIZONTAL, STABLE_MTF, STABLE_VERTICAL
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter, Quantity

FEWEST = 3  # PSFs that have a standard deviation without each of them
HALF = 40  # frequencies from zero to the end of the band, along each axis
THRESHOLDS: Array = np.linspace(0.0, 0.5, 51)
FIVE_PERCENT = 5  # index of the threshold of 5 %
METHOD = "standard deviation of repeated PSFs, uncertainty by leaving out each"


@dataclass(frozen=True, eq=False)
class Stability:
    """Mean and standard deviation (n, n) of the MTF at `frequencies` (n,) along rows and columns, from `count` PSFs;
    `sensitivity` (m,) of the region above each of `THRESHOLDS`."""

    frequencies: Array
    mean: Array
    std: Array
    sensitivity: Array
    numbers: dict[str, Quantity]

    @property
    def curves(self) -> dict[str, Array]:
        """s(Omega) over the least MTF of the region."""
        return {"least_mtf": THRESHOLDS, "sensitivity": self.sensitivity}


def stability_of(psfs: Sequence[tuple[Array, int]], limit: float = 0.03) -> Stability:
    """The stability of three or more PSFs, samples (k, k) and their number s per pixel; `limit` is the greatest
    sensitivity of the stable domain. Raises BadParameter for fewer."""
    if len(psfs) < FEWEST:
        raise BadParameter(
            f"stability needs {FEWEST} results or more; got {len(psfs)}", "take further photographs in the same place"
        )
    end = min(s for _, s in psfs) / 2
    frequencies = np.linspace(-end, end, 2 * HALF + 1)
    mtfs = np.stack([_mtf(h, s, frequencies) for h, s in psfs])
    every = np.arange(len(mtfs))
    whole = _summary(mtfs, frequencies, limit)
    without = np.stack([_summary(mtfs[every != i], frequencies, limit) for i in every])
    spread = np.sqrt((len(mtfs) - 1) / len(mtfs) * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    names = (SENSITIVITY, SENSITIVITY_AT_5, STABLE_MTF, STABLE_HORIZONTAL, STABLE_VERTICAL)
    numbers: dict[str, Quantity] = {
        name: Quantity(float(value), name.unit, float(u), METHOD, len(mtfs))
        for name, value, u in zip(names, whole, spread, strict=True)
        if np.isfinite(value) and np.isfinite(u)
    }
    mean, std = mtfs.mean(axis=0), mtfs.std(axis=0, ddof=1)
    return Stability(frequencies, mean, std, _sensitivity(mean, std), numbers)


def _mtf(h: Array, s: int, frequencies: Array) -> Array:
    """Modulus of the support's transfer function on the grid of frequencies, 1 at zero."""
    waves = np.exp(-2j * np.pi * np.outer(frequencies, (np.arange(len(h)) - len(h) // 2) / s))
    return np.asarray(np.abs(waves @ h @ waves.T) / abs(h.sum()))


def _sensitivity(mean: Array, std: Array) -> Array:
    """s(Omega) for every threshold; NaN where the region is empty."""
    regions = [mean >= least for least in THRESHOLDS]
    return np.array([std[region].mean() / mean[region].mean() if region.any() else np.nan for region in regions])


def _summary(mtfs: Array, frequencies: Array, limit: float) -> Array:
    """Sensitivity of the whole plane and above 5 %; least MTF of the stable domain, and its ends along rows and
    columns; NaN where no domain is stable."""
    mean, std = mtfs.mean(axis=0), mtfs.std(axis=0, ddof=1)
    sensitivity = _sensitivity(mean, std)
    stable = np.flatnonzero(sensitivity <= limit)
    least = THRESHOLDS[stable[0]] if len(stable) else np.nan
    ends = [_end(line, frequencies[HALF:], least) for line in (mean[HALF, HALF:], mean[HALF:, HALF])]
    return np.array([sensitivity[0], sensitivity[FIVE_PERCENT], least, *ends])


def _end(mtf: Array, frequencies: Array, least: float) -> float:
    """First frequency at which the MTF falls below a value, interpolated; the band's end where it does not."""
    below = np.flatnonzero(mtf < least)
    if not np.isfinite(least) or not len(below):
        return float(frequencies[-1]) if np.isfinite(least) else np.nan
    i = int(below[0])
    share = (mtf[i - 1] - least) / (mtf[i - 1] - mtf[i])
    return float(frequencies[i - 1] + share * (frequencies[i] - frequencies[i - 1]))
