"""What a camera model leaves undrawn: a smooth field over the frame that the residuals have in common, tested.

Residuals of a right model are noise. What a model cannot draw is the same for every view that shows a place of the
frame, and smooth. So the adjustment is offered, once it has come to rest, a field of displacements over the frame,
polynomials that no camera model stands for; how much of the sum of squares these take is held against what they would
take of mere noise (the F test). The noise is measured by the residuals themselves, so that points whose covariances are
all stated too small make no false alarm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import f as f_distribution

from procedures.geometry.adjustment import Adjustment, assemble
from procedures.geometry.cameras import Camera
from procedures.geometry.shape import ShapeModel
from procedures.geometry.views import ChartView

Array = npt.NDArray[np.float64]

DEGREE = 7
"""Highest power of place in the field."""
CHANCE = 0.005
"""Probability at which noise alone raises the alarm."""
NEW = 0.01
"""Share of a field that camera model, poses and chart must leave of it for it to count as something else."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """What is left undrawn.

    Attributes
    ----------
    probability : float
        That noise alone takes so much: the F test's p-value.
    rms_px : float
        Root mean square length of the field over the places seen, its own noise allowed for.
    coefficients : (2 k,) float64
        Of the field's polynomials, for x, then y.
    """

    probability: float
    rms_px: float
    coefficients: Array
    columns: int
    rows: int

    @property
    def significant(self) -> bool:
        """Whether it is more than noise."""
        return self.probability < CHANCE

    def at(self, pixels: Array) -> Array:
        """The field (n, 2), in pixels, at places (n, 2) of the frame."""
        basis = field_polynomials(pixels, self.columns, self.rows)
        return np.asarray(basis @ self.coefficients.reshape(2, -1).T)


def field_polynomials(pixels: Array, columns: int, rows: int) -> Array:
    """Products of Chebyshev polynomials at places (n, 2), up to a total degree of DEGREE, (n, k)."""
    u, v = 2 * pixels[:, 0] / (columns - 1) - 1, 2 * pixels[:, 1] / (rows - 1) - 1
    U, V = (np.polynomial.chebyshev.chebvander(np.clip(one, -1, 1), DEGREE) for one in (u, v))
    return np.stack([U[:, i] * V[:, j] for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)], axis=1)


def find_misfit(found: Adjustment, nodes: Array, views: Sequence[ChartView], shape: ShapeModel) -> Misfit:
    """The field that lowers an adjustment's sum of squares most, and whether that is more than chance."""
    camera = found.state.camera
    extra = [_columns(camera, view) for view in views]
    k = extra[0].shape[-1]
    S, b = assemble(found.state, nodes, views, shape, extra).reduced()
    known = len(found.covariance)
    field = (np.arange(len(S)) >= known) & (np.arange(len(S)) < known + k)
    cross = S[np.ix_(~field, field)]
    follow = np.linalg.solve(S[np.ix_(~field, ~field)], np.column_stack([cross, b[~field]]))
    left = S[np.ix_(field, field)] - cross.T @ follow[:, :-1]
    right = b[field] - cross.T @ follow[:, -1]
    total = sum(np.einsum("nak,nab,nbl->kl", e, np.linalg.inv(view.covariance), e, optimize=True)
                for e, view in zip(extra, views, strict=True))  # fmt: skip
    scale = 1 / np.sqrt(np.diag(total))
    values, vectors = np.linalg.eigh(left * np.outer(scale, scale))
    new = values > NEW
    if not new.any():  # the model draws all of it
        return Misfit(1.0, 0.0, np.zeros(k), camera.columns, camera.rows)
    directions = vectors[:, new] * scale[:, None]
    amplitudes = (directions.T @ right) / values[new]
    taken, count = float(np.sum(amplitudes**2 * values[new])), int(new.sum())
    freedom = found.freedom - count
    ratio = (taken / count) / ((found.chi_square - taken) / freedom)
    coefficients = directions @ amplitudes
    # the mean square of the field over all points, less what its noise would make it
    seen = np.concatenate([e.reshape(-1, k) for e in extra]) @ directions
    noise = found.scale**2 * float(np.sum(np.sum(seen**2, axis=0) / values[new]))
    square = (float(np.sum((seen @ amplitudes) ** 2)) - noise) / (len(seen) / 2)
    probability = float(f_distribution.sf(ratio, count, freedom))
    return Misfit(probability, float(np.sqrt(max(square, 0.0))), coefficients, camera.columns, camera.rows)


def _columns(camera: Camera, view: ChartView) -> Array:
    """How a view's points move with the field's coefficients, (n, 2, 2 k)."""
    basis = field_polynomials(view.points, camera.columns, camera.rows)
    return np.asarray(np.einsum("ab,nk->nabk", np.eye(2), basis).reshape(len(view), 2, -1))
