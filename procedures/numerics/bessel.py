"""Bessel's functions J0 and J1 and the integral of J0, by Bessel's integrals: SciPy's take longer to import.

J_n(x) is the mean over theta of cos(n theta - x sin theta) (NIST DLMF 10.9.2), and the integral of J0 that of
sin(x sin theta) / sin theta. Only the part even about both axes of theta contributes, so a quarter turn suffices. Over
whole periods the trapezoidal rule with N points has an error of J_N(x), which vanishes from N = 2 x + 80 on (Trefethen
and Weideman, SIAM Review 56, 2014).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array

MORE_POINTS = 40
LARGEST_BLOCK = 1 << 20
"""Values of the integrand per block."""


def j0(x: npt.ArrayLike) -> Array:
    """J0 at real x, to 1e-14."""
    return _mean(x, lambda x, sine: np.cos(x * sine))


def j1(x: npt.ArrayLike) -> Array:
    """J1 at real x, to 1e-14."""
    return _mean(x, lambda x, sine: np.sin(x * sine) * sine)


def integral_of_j0(x: npt.ArrayLike) -> Array:
    """The integral of J0 from 0 to real x, to 1e-14 of x."""
    return _mean(x, lambda x, sine: np.sin(x * sine) / sine)


def _mean(x: npt.ArrayLike, integrand: Callable[[Array, Array], Array]) -> Array:
    """Mean over theta of an integrand of x and sin theta, at points that avoid its removable poles."""
    values = np.asarray(x, dtype=np.float64)
    flat = values.ravel()
    points = (int(np.abs(flat).max(initial=0.0)) + MORE_POINTS) // 2 + 1
    sine = np.sin(np.pi / 2 * (np.arange(points) + 0.5) / points)
    rows = max(LARGEST_BLOCK // points, 1)
    out = np.empty(len(flat))
    for first in range(0, len(flat), rows):
        part = slice(first, first + rows)
        out[part] = integrand(flat[part, None], sine).mean(axis=1)
    return out.reshape(values.shape)
