"""Systematic residual of a camera model: a smooth displacement field common to all views, with an F test.

The residuals of an adequate model are noise. What a model cannot describe is smooth and the same in every view that
shows a place of the frame. After the adjustment, a displacement field over the frame is added to the unknowns:
polynomials that no camera model contains. The decrease of the sum of squares is compared with that expected from noise,
whose level comes from the residuals, so that covariances that are all stated too small cause no false alarm.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from procedures.geometry.adjustment import Adjustment, extra_terms
from procedures.geometry.cameras import CameraModel
from procedures.geometry.views import ChartView
from procedures.numerics.arrays import Array

DEGREE = 7  # total degree of the polynomials
SIGNIFICANCE = 0.005  # probability of a false alarm
INDEPENDENT = 0.01
"""Share of a component of the field not described by camera, poses and chart, from which it counts as independent."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """The systematic residual.

    probability : float, of such a decrease by noise alone: p-value of the F test
    rms_px : float, root mean square length of the field over the points, corrected for its noise
    coefficients : (2 k,) float64, of the field's polynomials, for x, then y
    """

    probability: float
    rms_px: float
    coefficients: Array
    columns: int
    rows: int

    @property
    def significant(self) -> bool:
        """Whether it exceeds noise."""
        return self.probability < SIGNIFICANCE

    def at(self, pixels: Array) -> Array:
        """The field (n, 2), in pixels, at places (n, 2) of the frame."""
        basis = _polynomials(pixels, self.columns, self.rows)
        return np.asarray(basis @ self.coefficients.reshape(2, -1).T)


def _polynomials(pixels: Array, columns: int, rows: int) -> Array:
    """Products of Chebyshev polynomials at places (n, 2), up to a total degree of DEGREE, (n, k)."""
    u, v = 2 * pixels[:, 0] / (columns - 1) - 1, 2 * pixels[:, 1] / (rows - 1) - 1
    U, V = (np.polynomial.chebyshev.chebvander(np.clip(one, -1, 1), DEGREE) for one in (u, v))
    return np.stack([U[:, i] * V[:, j] for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)], axis=1)


def find_misfit(fit: Adjustment) -> Misfit:
    """The field that reduces the sum of squares of an adjustment most, and its significance."""
    camera, views = fit.state.camera, fit.problem.views
    extra = [_columns(camera, view) for view in views]
    k = extra[0].shape[-1]
    terms = extra_terms(fit, extra)
    total = sum(np.einsum("nak,nab,nbl->kl", e, np.linalg.inv(view.covariance), e, optimize=True)
                for e, view in zip(extra, views, strict=True))  # fmt: skip
    scale = 1 / np.sqrt(np.diag(total))
    values, vectors = np.linalg.eigh(terms.matrix * np.outer(scale, scale))
    new = values > INDEPENDENT
    if not new.any():
        return Misfit(1.0, 0.0, np.zeros(k), camera.columns, camera.rows)
    directions = vectors[:, new] * scale[:, None]
    amplitudes = (directions.T @ terms.right) / values[new]
    decrease, count = float(np.sum(amplitudes**2 * values[new])), int(new.sum())
    freedom = fit.freedom - count
    ratio = (decrease / count) / ((fit.chi_square - decrease) / freedom)
    # the mean square of the field over all points, minus the contribution of its noise
    at_points = np.concatenate([e.reshape(-1, k) for e in extra]) @ directions
    noise = fit.scale**2 * float(np.sum(np.sum(at_points**2, axis=0) / values[new]))
    square = (float(np.sum((at_points @ amplitudes) ** 2)) - noise) / (len(at_points) / 2)
    probability = float(fdtrc(count, freedom, ratio))
    rms_px = float(np.sqrt(max(square, 0.0)))
    return Misfit(probability, rms_px, directions @ amplitudes, camera.columns, camera.rows)


def _columns(camera: CameraModel, view: ChartView) -> Array:
    """Derivatives of a view's points by the coefficients of the field, (n, 2, 2 k)."""
    basis = _polynomials(view.points, camera.columns, camera.rows)
    return np.asarray(np.einsum("ab,nk->nabk", np.eye(2), basis).reshape(len(view), 2, -1))
