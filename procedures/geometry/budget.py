"""Uncertainty budget of a geometry: points, flatness and print of the chart, model, shutter, and scale.

The variance of every number is divided by nested conditions. Noise of the points alone remains where the chart is known
and the lens is a formula; the freedom of the spline, and the discrepancy of a formula, are the model's part; what the
unknown chart adds is that of flatness and print. The parts sum to the stated variance.

Source: ISO/IEC Guide 98-3 (GUM), section 5.1 and annex H.
"""

from dataclasses import dataclass

import numpy as np

from procedures.geometry.adjustment import Adjustment
from procedures.geometry.spline_camera import SplineCamera
from procedures.numerics.arrays import Array, Indices

POINTS, FLATNESS, MODEL, SHUTTER, SCALE = "points", "flatness", "model", "shutter", "scale"
TERMS = (POINTS, FLATNESS, MODEL, SHUTTER, SCALE)


@dataclass(frozen=True, eq=False)
class VarianceParts:
    """Covariances of the unknowns of an adjustment by source; that of the model is the rest.

    points, flatness : (known, known) float64
    shutter : (known,) float64, change of the unknowns by one standard uncertainty of the row time
    """

    points: Array
    flatness: Array
    shutter: Array

    def budget(self, total: float, J: Array, count: int = 1, scale: float = 0.0) -> dict[str, float]:
        """Terms of a number's standard uncertainty.

        total : float, the stated standard uncertainty
        J : (m, known) float64, derivative by the unknowns
        count : int, the number is the root of the sum of the m squared components, divided by this count
        scale : float, contribution of the chart's scale
        """
        squares = {
            POINTS: float(np.sum((J @ self.points) * J)) / count,
            FLATNESS: float(np.sum((J @ self.flatness) * J)) / count,
            SHUTTER: float(np.sum((J @ self.shutter) ** 2)) / count,
            SCALE: scale**2,
        }
        rest = sum(squares.values())
        # what is known of missing terms leaves a formula less uncertain than its response to the reference
        share = min(1.0, total**2 / rest) if rest > 0 else 1.0
        squares = {term: share * square for term, square in squares.items()} | {MODEL: max(total**2 - rest, 0.0)}
        return {term: float(np.sqrt(squares[term])) for term in TERMS}


def variance_parts(fit: Adjustment, *, with_shutter: bool) -> VarianceParts:
    """The covariances by source; `with_shutter`: the last discrepancy of the adjustment is that of the row time."""
    camera, known = fit.state.camera, len(fit.covariance)
    p = len(camera.params)
    formula = camera.plain if isinstance(camera, SplineCamera) else p
    U = fit.problem.system(fit.state).U
    poses = np.arange(fit.shared, known)
    every = _inverse(U, np.concatenate([np.arange(p), poses]), known)
    simple = every if formula == p else _inverse(U, np.concatenate([np.arange(formula), poses]), known)
    square = fit.scale**2
    shutter = fit.discrepancy.unknowns[-1] if with_shutter and fit.discrepancy is not None else np.zeros(known)
    return VarianceParts(square * simple, square * (fit.covariance - every), shutter)


def _inverse(U: Array, free: Indices, known: int) -> Array:
    """Covariance (known, known) where only some unknowns are free."""
    part = U[np.ix_(free, free)]
    scale = np.sqrt(np.diag(part))
    covariance = np.zeros((known, known))
    covariance[np.ix_(free, free)] = np.linalg.inv(part / np.outer(scale, scale)) / np.outer(scale, scale)
    return covariance
