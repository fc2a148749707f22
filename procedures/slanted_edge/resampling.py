"""How sure an MTF is: the same from rows drawn anew.

Every row along the edge is one draw of all that varies: noise, the edge's raggedness, blur that changes along it. Rows
are drawn with random weights (the Bayesian bootstrap), not zero or more times: no bin then loses all its samples.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.slanted_edge.edge_line import tukey
from procedures.slanted_edge.profile import BINS, Profile, filled, solve_light
from procedures.slanted_edge.tail import with_tail
from procedures.slanted_edge.transfer import mtf_of, noise_gain

Array = npt.NDArray[np.float64]

DRAWS = 300
SEED = 12233


def resampled_mtf(profile: Profile, draws: int = DRAWS) -> Array:
    """MTFs of rows drawn anew, (draws, f), spread about the profile's own as it is about the truth.

    References
    ----------
    Rubin, The Bayesian bootstrap, Annals of Statistics 9, 1981. A mean of m rows with weights of unit exponentials
    varies by (m - 1) / (m + 1) of what it should: the spread is enlarged by that. The values are not moved to their
    bins' centres anew with every draw, where noise moves them too: by `noise_gain`.
    """
    n = len(profile.sums)
    rng = np.random.default_rng(SEED)
    weight = rng.exponential(size=(draws, n))
    esf = filled(weight @ profile.sums, weight @ profile.counts)
    normal, right = (np.tensordot(weight, part, axes=1) for part in (profile.light_normal, profile.light_right))
    sureness = profile.tail_weight, profile.contrast
    normal, right = profile.lean.added(normal, right, rng.standard_normal(draws))
    light = solve_light(*with_tail(normal, right, profile.tail_known, *sureness, rng.standard_normal(draws)))
    tail = light[:, 2] / (light[:, 1] - light[:, 0])
    # the values were divided by the light that all rows gave: what theirs differs by changes them with the distance
    level = profile.esf + profile.light[0] / profile.contrast
    esf = esf - (light[:, 3:4] - profile.light[3]) * profile.centres * level
    drawn = mtf_of(esf, tail, profile.flat_px, profile.end_px)
    own = mtf_of(profile.esf, np.asarray(profile.tail), profile.flat_px, profile.end_px)
    m = max(float(np.mean(profile.counts.sum(axis=0)[profile.counts.sum(axis=0) > 0])), 2.0)
    return np.asarray(own + (drawn - own) * noise_gain() * np.sqrt((m + 1) / (m - 1)))


def expected_noise(profile: Profile, mtf50: float) -> float:
    """Relative uncertainty of MTF50 to expect of this noise through this window, before rows are drawn; NaN stays.

    Differences of bins of noise s have the spectrum 2 pi f s / BINS times the window's norm; half of its power is
    along the transfer function, which falls by some 0.65 for a relative step of frequency where it is one half.
    """
    counts = profile.counts.sum(axis=0)
    bin_noise = profile.noise / abs(profile.contrast) / np.sqrt(max(float(counts[counts > 0].mean()), 1.0))
    window = float(np.linalg.norm(tukey(profile.centres, profile.flat_px, profile.end_px)))
    return float(2 * np.pi * mtf50 / BINS * bin_noise * window / (2**0.5 * 0.65))
