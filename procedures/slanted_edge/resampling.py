"""Uncertainty of an MTF by the Bayesian bootstrap over rows.

The rows along the edge are samples of all that varies: noise, roughness, blur that changes along the edge. Random
weights instead of repetitions leave no bin empty.
"""

from __future__ import annotations

import numpy as np

from procedures.numerics.arrays import Array
from procedures.slanted_edge.edge_line import tukey
from procedures.slanted_edge.profile import BINS, EdgeProfile, filled, solve_light
from procedures.slanted_edge.tail import with_tail
from procedures.slanted_edge.transfer import mtf_of, noise_gain

DRAWS = 300
SEED = 12233


def resampled_mtf(profile: EdgeProfile, draws: int = DRAWS) -> Array:
    """MTFs of resampled rows, (draws, f), which scatter about the profile's MTF as that does about the truth.

    References ---------- Rubin, The Bayesian bootstrap, Annals of Statistics 9, 1981. The variance of a mean of m rows
    with exponential weights is (m - 1) / (m + 1) of the true one; the spread is enlarged accordingly, and by
    `noise_gain`, as the values are not moved to the centres of their bins in each draw.
    """
    n = len(profile.sums)
    rng = np.random.default_rng(SEED)
    weight = rng.exponential(size=(draws, n))
    esf = filled(weight @ profile.sums, weight @ profile.counts)
    normal, right = (np.tensordot(weight, part, axes=1) for part in (profile.light_normal, profile.light_right))
    sureness = profile.tail_weight, profile.contrast
    normal, right = profile.lean.added(normal, right, rng.standard_normal(draws))
    light = solve_light(*with_tail(normal, right, profile.tail_prior, *sureness, rng.standard_normal(draws)))
    tail = light[:, 2] / (light[:, 1] - light[:, 0])
    # the values were divided by the slope of the light of all rows: that of the draw differs
    level = profile.esf + profile.light[0] / profile.contrast
    esf = esf - (light[:, 3:4] - profile.light[3]) * profile.centres * level
    drawn = mtf_of(esf, tail, profile.flat_px, profile.end_px)
    own = mtf_of(profile.esf, np.asarray(profile.tail), profile.flat_px, profile.end_px)
    m = max(float(np.mean(profile.counts.sum(axis=0)[profile.counts.sum(axis=0) > 0])), 2.0)
    return np.asarray(own + (drawn - own) * noise_gain() * np.sqrt((m + 1) / (m - 1)))


def expected_noise(profile: EdgeProfile, mtf50: float) -> float:
    """Relative uncertainty of MTF50 expected of this noise and window; NaN where MTF50 is.

    Differences of bins of noise s have the spectrum 2 pi f s / BINS times the window's norm. Half of its power is in
    phase with the transfer function, whose derivative by the logarithm of the frequency is about -0.65 at one half.
    """
    counts = profile.counts.sum(axis=0)
    bin_noise = profile.noise / abs(profile.contrast) / np.sqrt(max(float(counts[counts > 0].mean()), 1.0))
    window = float(np.linalg.norm(tukey(profile.centres, profile.flat_px, profile.end_px)))
    return float(2 * np.pi * mtf50 / BINS * bin_noise * window / (2**0.5 * 0.65))
