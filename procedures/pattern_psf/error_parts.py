"""Uncertainty budget of each number, and its variation over the chart, from the fit's equations.

With F the joint information matrix of samples and nuisance parameters and g the gradient of a number, its variance is
g' F^-1 g. Fixed nuisance parameters are removed from F: freeing one group after the other gives the contribution of
each. F^-1 g also maps the residual of a part of the chart to the change of the number by that part.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.choice import Budget
from procedures.numerics.arrays import Array, Mask
from procedures.numerics.normal_equations import NormalEquations
from procedures.pattern_psf.refine import GEOMETRY, RESPONSE, SPREAD, TAIL, TILES, ChartFit
from procedures.psf import Psf
from procedures.quality import Quality

GROUPS = {
    "light": slice(GEOMETRY, GEOMETRY + RESPONSE + 1),
    "geometry": slice(0, GEOMETRY),
    "print": slice(GEOMETRY + SPREAD, GEOMETRY + SPREAD + 1),
    "tail": slice(GEOMETRY + TAIL, None),
}
"""Columns of the nuisance parameters by group, in the order in which they are freed."""
CALIBRATED = {
    "light": slice(GEOMETRY, GEOMETRY + RESPONSE),
    "sensor": slice(GEOMETRY + RESPONSE, GEOMETRY + RESPONSE + 1),
    **{group: columns for group, columns in GROUPS.items() if group != "light"},
}
"""Groups where the sensor's response is known from its calibration."""


@dataclass(frozen=True)
class Variation:
    """A number in two halves of the chart.

    halves : "left" and "right", "top" and "bottom", or "centre" and "rim"
    values : (float, float)
    sigmas : difference of the values in standard uncertainties
    """

    name: str
    halves: tuple[str, str]
    values: tuple[float, float]
    sigmas: float


@dataclass(frozen=True)
class ErrorParts:
    """Uncertainty budgets of the numbers, and their scatter over the chart.

    mismatch : variance of the numbers by the tiles' scatter, over that by white noise; variations : requested numbers,
    left against right, top against bottom, centre against rim.
    """

    parts: Mapping[str, Budget]
    mismatch: Mapping[str, float]
    variations: tuple[Variation, ...]


def error_parts(
    fit: ChartFit, psf: Psf, quality: Quality, checked: tuple[str, ...], groups: Mapping[str, slice]
) -> ErrorParts:
    """Uncertainties of all numbers, and of the curves at their knots, by GROUPS or CALIBRATED; `checked` : numbers
    whose variation is reported."""
    names = list(quality.gradients)
    by_psf = np.array([quality.gradients[name] for name in names])
    freed, weights = _freed(fit.equations, _by_fitted(by_psf, fit, psf), groups)
    whole = np.einsum("ij,ij->i", by_psf @ psf.parameter_covariance, by_psf)
    added = {"noise": freed["noise"]}
    last = freed["noise"]
    for group in groups:
        added[group] = np.maximum(freed[group] - last, 0)
        last = freed[group]
    scale = fit.residual_std**2
    added = {group: variance * scale for group, variance in added.items()}
    # the contribution of the centre's convention counts as geometry
    added["geometry"] = added["geometry"] + np.maximum(whole - sum(added.values()), 0)
    changes = fit.scores @ weights.T  # change of each number by each tile
    # tiles that agree may share an error, which correlates the residual of the four neighbours
    coherent = 1 + 4 * max(fit.neighbour_correlation, 0.0)
    ratio = np.maximum(np.sum(changes**2, axis=0) / np.maximum(last * scale, 1e-300), coherent)
    added["mismatch"] = np.maximum(ratio - 1, 0) * last * scale
    parts = {
        name: {group: float(np.sqrt(variance[i])) for group, variance in added.items()} for i, name in enumerate(names)
    }
    variations = [
        variation
        for i, name in enumerate(names)
        if name in checked
        for variation in _variations(name, quality.numbers[name].value, changes[:, i], float(np.sqrt(last[i] * scale)))
    ]
    mismatch = {name: float(ratio[i]) for i, name in enumerate(names) if name in quality.numbers}
    return ErrorParts(parts, mismatch, tuple(variations))


def _by_fitted(gradients: Array, fit: ChartFit, psf: Psf) -> Array:
    """Convert gradients (b, k^2 + q) by the PSF of sum 1 to gradients (b, k^2 + p) by all fitted parameters."""
    n, total = len(fit.h), float(fit.h.sum())
    along = gradients @ psf.parameters
    fitted = np.zeros((len(gradients), n + len(fit.equations.ZZ)))
    fitted[:, :n] = (gradients[:, :n] - along[:, None]) / total
    fitted[:, n + GEOMETRY + TAIL :] = gradients[:, n:] / total
    return fitted


def _freed(equations: NormalEquations, gradients: Array, groups: Mapping[str, slice]) -> tuple[dict[str, Array], Array]:
    """Variances (b,) of the numbers for unit noise, the groups freed one after the other; and F^-1 g, (b, n + p)."""
    AZ, ZZ = equations.AZ, equations.ZZ
    n, b = len(AZ), len(gradients)
    solved = equations.inverse_where_known @ np.hstack([AZ, gradients[:, :n].T])
    of_Z, of_g = solved[:, : AZ.shape[1]], solved[:, AZ.shape[1] :]
    information = ZZ - AZ.T @ of_Z  # information of the nuisance parameters with free h
    right_side = gradients[:, n:].T - AZ.T @ of_g  # (p, b)
    variances = {"noise": np.einsum("bi,ib->b", gradients[:, :n], of_g)}
    free = np.zeros(AZ.shape[1], dtype=bool)
    nuisance = np.zeros((AZ.shape[1], b))
    for group, columns in groups.items():
        free[columns] = True
        solution = np.linalg.solve(information[np.ix_(free, free)], right_side[free])
        variances[group] = variances["noise"] + np.sum(right_side[free] * solution, axis=0)
        nuisance = np.zeros((AZ.shape[1], b))
        nuisance[free] = solution
    return variances, np.hstack([(of_g - of_Z @ nuisance).T, nuisance.T])


def _variations(name: str, value: float, changes: Array, uncertainty: float) -> list[Variation]:
    """Compare one number in parts of the chart; `changes` (TILES^2,) are those of the tiles."""
    grid, rim = changes.reshape(TILES, TILES), TILES // 6
    inner = np.zeros(grid.shape, dtype=bool)
    inner[rim : TILES - rim, rim : TILES - rim] = True
    column, row = np.meshgrid(np.arange(TILES), np.arange(TILES))
    pairs = (
        (("left", "right"), column < TILES // 2),
        (("top", "bottom"), row < TILES // 2),
        (("centre", "rim"), inner),
    )
    return [_variation(name, halves, grid, first, value, uncertainty) for halves, first in pairs]


def _variation(
    name: str, halves: tuple[str, str], grid: Array, first: Mask, value: float, uncertainty: float
) -> Variation:
    """A number in the first tiles and in the others, whose information is their share of all."""
    share = float(first.mean())
    a, b = float(grid[first].sum()) / share, float(grid[~first].sum()) / (1 - share)
    return Variation(name, halves, (value + a, value + b), (a - b) / (uncertainty * (1 / share / (1 - share)) ** 0.5))
