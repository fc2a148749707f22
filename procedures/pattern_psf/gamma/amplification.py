"""How much a view of the chart amplifies the photograph's noise, and how little any chart could: gamma.

gamma = sum 1 / sigma_i^2 over the singular values of S_s C[u], the chart as the sensor's s grid sees it, from black 0
to white 1. Noise of variance sigma^2 then makes an expected square error gamma sigma^2 of all PSF values together: the
root of gamma times the noise is the error's norm. It is a number of the view alone. What light, geometry, print and
tail cost beside it is in the uncertainties.

References
----------
Delbracio's thesis, section 2.3: equation of gamma in 2.3.1, Proposition 1 in 2.3.2.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics.normal_equations import NormalEquations
from procedures.numerics.triangular import inverse_lower

Array = npt.NDArray[np.float64]


def gamma(gram: Array) -> float:
    """The trace of the inverse of A'A (n, n), which is the sum of 1 / sigma_i^2; infinite where A does not determine h.

    Source: thesis, section 2.3.1.
    """
    try:
        factor = np.linalg.cholesky(gram)
    except np.linalg.LinAlgError:
        return float("inf")
    return float(np.sum(inverse_lower(factor) ** 2))


def gamma_of_fit(equations: NormalEquations, constant: int, weight: Array) -> float:
    """The gamma of a photograph, whatever the scale of its weights.

    Parameters
    ----------
    equations : NormalEquations
        Of a chart from black -1/2 to white 1/2.
    constant : int
        The nuisance column that is 1 for every sample.
    weight : (m,) float64
        One over each sample's noise.
    """
    # every entry of A gains a half: A'A gains l 1' + 1 l' + c, of rank 2, and Woodbury's identity tells its inverse
    squares = float(weight @ weight)
    level = equations.AZ[:, constant] / 2
    C, gained = equations.inverse_where_known, np.column_stack([level, np.ones_like(level)])
    through = C @ gained
    inner = np.array([[-squares / 4, 1.0], [1.0, 0.0]]) + gained.T @ through
    trace = np.trace(C) - np.trace(np.linalg.solve(inner, through.T @ through))
    return float(trace) * squares / len(weight)


def gamma_bound(m: int, n: int) -> float:
    """Smallest gamma of any chart with values in [0, 1], m samples and n PSF values.

    Source: thesis, Proposition 1 with a = 0, b = 1.
    """
    return (1 + 4 * (n - 1) ** 2) / (m * n)
