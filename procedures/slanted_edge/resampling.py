"""How sure an MTF is: the same from rows drawn anew.

Every row along the edge is one draw of all that varies: noise, the edge's raggedness, blur that changes along it. Rows
are drawn with random weights (the Bayesian bootstrap), not zero or more times: no bin then loses all its samples.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.slanted_edge.profile import Profile, filled, solve_light
from procedures.slanted_edge.transfer import mtf_of

Array = npt.NDArray[np.float64]

DRAWS = 200
SEED = 12233


def resampled_mtf(profile: Profile, draws: int = DRAWS) -> Array:
    """MTFs of rows drawn anew, (draws, f), spread about the profile's own as it is about the truth.

    References
    ----------
    Rubin, The Bayesian bootstrap, Annals of Statistics 9, 1981. A mean of m rows with weights of unit exponentials
    varies by (m - 1) / (m + 1) of what it should: the spread is enlarged by that.
    """
    n = len(profile.sums)
    weight = np.random.default_rng(SEED).exponential(size=(draws, n))
    esf = filled(weight @ profile.sums, weight @ profile.counts)
    light = solve_light(
        np.tensordot(weight, profile.light_normal, axes=1), np.tensordot(weight, profile.light_right, axes=1)
    )
    tail = profile.known_tail + light[:, 2] / (light[:, 1] - light[:, 0])
    # the values were divided by the light that all rows gave: what theirs differs by changes them with the distance
    level = profile.esf + profile.light[0] / profile.contrast
    esf = esf - (light[:, 3:4] - profile.light[3]) * profile.centres * level
    drawn = mtf_of(esf, tail, profile.flat_px, profile.end_px)
    own = mtf_of(profile.esf, np.asarray(profile.tail), profile.flat_px, profile.end_px)
    m = max(float(np.mean(profile.counts.sum(axis=0)[profile.counts.sum(axis=0) > 0])), 2.0)
    return np.asarray(own + (drawn - own) * np.sqrt((m + 1) / (m - 1)))
