"""Noise amplification gamma of a view of the chart, and its lower bound over all charts.

gamma = sum 1 / sigma_i^2 over the singular values of S_s C[u], the chart on the sensor's s grid, black 0, white 1.
Noise of variance sigma^2 causes an expected squared error of the PSF of gamma sigma^2, so sqrt(gamma) times the noise
is the norm of the error. gamma depends on the view alone; the contributions of light, geometry, print and tail are in
the uncertainties.

References
----------
Delbracio's thesis, section 2.3: equation of gamma in 2.3.1, Proposition 1 in 2.3.2.
"""

from __future__ import annotations

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.normal_equations import NormalEquations


def gamma_of_fit(equations: NormalEquations, constant: int, weight: Array) -> float:
    """Compute gamma of a photograph, independent of the scale of its weights.

    Parameters
    ----------
    equations : normal equations of a chart from black -1/2 to white 1/2
    constant : index of the nuisance column that is 1 for every sample
    weight : (m,) reciprocal of each sample's noise
    """
    # adding 1/2 to every entry of A adds l 1' + 1 l' + c, of rank 2, to A'A; Woodbury's identity gives the inverse
    squares = float(weight @ weight)
    level = equations.AZ[:, constant] / 2
    C, gained = equations.inverse_where_known, np.column_stack([level, np.ones_like(level)])
    through = C @ gained
    inner = np.array([[-squares / 4, 1.0], [1.0, 0.0]]) + gained.T @ through
    trace = np.trace(C) - np.trace(np.linalg.solve(inner, through.T @ through))
    return float(trace) * squares / len(weight)


def gamma_bound(m: int, n: int) -> float:
    """Lower bound of gamma for any chart with values in [0, 1], m samples and n PSF values.

    Source: thesis, Proposition 1 with a = 0, b = 1.
    """
    return (1 + 4 * (n - 1) ** 2) / (m * n)
