"""Camera, poses and the chart's own shape together, every point weighing what it is worth, with one covariance.

pycolmap knows neither the points' covariances nor what is known beforehand of a chart's shape, so this last adjustment
is our own: the Levenberg-Marquardt method of `procedures.numerics.damped` on

    sum |W (project(R (X + B c + e) + t) - x)|^2 + sum (c / prior)^2 + sum (e / node)^2 + sum (k / beforehand)^2

in the camera's parameters k, the poses, the shape's terms c and every node's own error e.
The errors e, three for each of hundreds of nodes, meet in the system only each with itself: they are eliminated node by
node (the Schur complement of bundle adjustment), and what is left is small and dense. All nodes moved as one body, or
grown, would be a pose or another scale: Lagrange's multipliers, seven more unknowns, keep their errors from doing that.

References
----------
Triggs, McLauchlan, Hartley, Fitzgibbon, Bundle adjustment: a modern synthesis, 2000, section 6.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from procedures.geometry.cameras import Camera
from procedures.geometry.node_kernels import add_view
from procedures.geometry.shape import ShapeModel
from procedures.geometry.views import ChartView, Pose
from procedures.numerics.damped import minimise
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]

CONVERGENCE = 1e-3
"""Decrease of chi-square, over its mean per coordinate, that is worth no other step: a thirtieth of an uncertainty."""
OPEN = 1e-15
"""Least share of the scaled system's eigenvalues that rounding leaves meaningful."""
POSE = 6
"""Numbers of a pose's change: rotation (3) about the camera's axes in radians, then translation (3) in mm."""


@dataclass(frozen=True, eq=False)
class AdjustmentState:
    """Camera, poses, and the chart's shape.

    Attributes
    ----------
    camera : Camera
    poses : tuple of Pose
    terms_mm : (q,) float64
        The shape's terms.
    errors_mm : (N, 3) float64
        Every node's own error.
    """

    camera: Camera
    poses: tuple[Pose, ...]
    terms_mm: Array
    errors_mm: Array

    def deviations_mm(self, shape: ShapeModel) -> Array:
        """How far every node lies from its plan, (N, 3)."""
        return np.asarray(shape.terms @ self.terms_mm + self.errors_mm)


@dataclass(frozen=True, eq=False)
class System:
    """The normal equations of a state, the nodes' own errors still in them.

    The first M unknowns are the camera's parameters (p), the shape's terms (q), six for every pose, the extra columns,
    and the multipliers; every node has three more.

    Attributes
    ----------
    U : (M, M), u : (M,)
        J'J and J'r of the first.
    V : (N, 3, 3), v : (N, 3)
        The same of every node's errors.
    W : (N, 3, M)
        What they have in common.
    """

    U: Array
    u: Array
    V: Array
    v: Array
    W: Array

    @property
    def right(self) -> Array:
        """u and v in one."""
        return np.concatenate([self.u, self.v.ravel()])

    def reduced(self) -> tuple[Array, Array]:
        """Matrix and right side of the first unknowns, the nodes' errors eliminated."""
        # with V = L L', W'V^-1 W is the square of L^-1 W: half the work of a product of two matrices
        inverse = np.linalg.inv(np.linalg.cholesky(self.V))
        root, right = (inverse @ self.W).reshape(-1, len(self.u)), (inverse @ self.v[..., None]).ravel()
        return self.U - root.T @ root, self.u - root.T @ right

    def errors(self, step: Array) -> Array:
        """The step (N, 3) of the nodes' errors that goes with one of the first unknowns."""
        return self.solved((self.v - self.W @ step)[..., None])[..., 0]

    def solved(self, right: Array) -> Array:
        """V^-1 times (N, 3, k); 0 where a node has no error of its own."""
        return np.asarray(np.linalg.solve(self.V, right))


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The answer, with its covariance for the points' covariances as they were given.

    Attributes
    ----------
    state : AdjustmentState
    covariance : (p + q + 6 views, p + q + 6 views) float64
        Of the camera's parameters, the shape's terms, and the poses' changes, in this order.
    errors_variance : (N, 3) float64
        Of the nodes' own errors, in square mm.
    chi_square : float
        Of the points alone.
    freedom : float
        Number of coordinates less what was fitted to them, what is known beforehand counted as far as it holds.
    """

    state: AdjustmentState
    covariance: Array
    errors_variance: Array
    chi_square: float
    freedom: float

    @property
    def scale(self) -> float:
        """Residual in units of the points' covariances: 1 where these, the model and the chart's shape are right."""
        return float(np.sqrt(self.chi_square / self.freedom))


class NotConverged(Refused):
    """The adjustment did not reach the minimum: a failure of the numerics, which says nothing of the views."""


def adjust(start: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel) -> Adjustment:
    """The answer from a state near it.

    Parameters
    ----------
    start : AdjustmentState
    nodes : (N, 3) float64
        The chart's plan, in mm.
    views : sequence of ChartView
    shape : ShapeModel

    Raises
    ------
    NotConverged
        If the minimum is not reached.
    Refused
        If the views do not determine the camera.
    """
    tolerance = CONVERGENCE / sum(2 * len(view) for view in views)
    found = minimise(_ChartProblem(nodes, views, shape), start, tolerance=tolerance)
    if not found.converged:
        raise NotConverged(
            f"the adjustment of camera and poses must converge; with {start.camera.model} it did not in "
            f"{found.iterations} iterations; the last relative decrease of the sum of squares was {found.decrease:.1e}",
            "name a simpler camera model, or add views of the chart, tilted differently and spread over the frame",
        )
    return _concluded(found.state, nodes, views, shape, assemble(found.state, nodes, views, shape))


@dataclass(frozen=True, eq=False)
class _ChartProblem:
    """Camera, poses and the chart's shape as a problem of least squares."""

    nodes: Array
    views: Sequence[ChartView]
    shape: ShapeModel

    def residual(self, state: AdjustmentState) -> Array:
        """Of all points, then of what is known beforehand."""
        points = (residual(state, self.nodes, view, self.shape, i).ravel() for i, view in enumerate(self.views))
        return np.concatenate([*points, *_prior_residuals(state, self.shape)])

    def linearise(self, state: AdjustmentState) -> _ChartLinearisation:
        """The normal equations about a state."""
        return _ChartLinearisation(state, self, self.residual(state))

    def moved(self, state: AdjustmentState, step: Array) -> AdjustmentState:
        """The state after a step: of the first unknowns, then of the nodes' errors."""
        errors = self.nodes.size
        return _moved(state, step[:-errors], step[-errors:].reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class _ChartLinearisation:
    """The normal equations about a state, solved with the nodes' errors eliminated."""

    state: AdjustmentState
    problem: _ChartProblem
    residual: Array

    @cached_property
    def _system(self) -> System:
        return assemble(self.state, self.problem.nodes, self.problem.views, self.problem.shape)

    @property
    def gradient(self) -> Array:
        """J'r."""
        return self._system.right

    @cached_property
    def scale(self) -> Array:
        """Diagonal of J'J; 0 for the multipliers, which are no unknowns of the sum of squares."""
        first = np.diag(self._system.U).copy()
        first[-self.problem.shape.similarity.shape[-1] :] = 0.0
        return np.concatenate([first, np.einsum("naa->na", self._system.V).ravel()])

    @property
    def unknowns(self) -> Array:
        """Values of the unknowns; poses count by their distance."""
        state, count = self.state, self.problem.shape.similarity.shape[-1]
        poses = [np.concatenate([np.zeros(3), pose.t]) for pose in state.poses]
        return np.concatenate([state.camera.params, state.terms_mm, *poses, np.zeros(count), state.errors_mm.ravel()])

    def transposed(self, residual: Array) -> Array:
        """J' times residuals; those of what is known beforehand are linear and have no second derivative."""
        one, cuts = self.problem, np.cumsum([2 * len(view) for view in self.problem.views])
        parts = [part.reshape(-1, 2) for part in np.split(residual, cuts)[:-1]]
        return _of_points(self.state, one.nodes, one.views, one.shape, parts).right

    def solve(self, right: Array, damping: float) -> Array:
        """(J'J + damping D)^-1 times the unknowns' right side."""
        system = self._system
        M = len(system.u)
        damped = replace(
            system,
            U=system.U + damping * np.diag(self.scale[:M]),
            V=system.V + damping * system.V * np.eye(3),
            u=right[:M],
            v=right[M:].reshape(-1, 3),
        )
        step = _solve(*damped.reduced())
        return np.concatenate([step, damped.errors(step).ravel()])


def _prior_residuals(state: AdjustmentState, shape: ShapeModel) -> tuple[Array, Array]:
    """What is known beforehand of camera and terms, and of the nodes' own errors, in standard deviations."""
    spread = np.concatenate([state.camera.beforehand, shape.prior_mm])
    errors = state.errors_mm / shape.node_mm if shape.node_mm.all() else np.zeros(0)
    return np.concatenate([state.camera.params, state.terms_mm]) / spread, errors.ravel()


def _solve(S: Array, b: Array) -> Array:
    """The step, in unknowns that are scaled so that each is worth about as much."""
    scale = np.sqrt(np.abs(np.diag(S)))
    return np.asarray(np.linalg.solve(S / np.outer(scale, scale), b / scale) / scale)


def _inverse(S: Array) -> Array:
    """The unknowns' covariance; raises Refused where the views leave some of them open."""
    scale = np.sqrt(np.abs(np.diag(S)))
    values, vectors = np.linalg.eigh(S / np.outer(scale, scale))
    if np.abs(values).min() < OPEN or np.count_nonzero(values < 0) != np.count_nonzero(np.diag(S) < 0):
        raise _undetermined()
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))


def _undetermined() -> Refused:
    return Refused(
        "these views do not determine the camera", "tilt the chart by 20 degrees and more, and fill the frame"
    )


def _concluded(
    state: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel, system: System
) -> Adjustment:
    p, q, count = len(state.camera.params), len(shape.prior_mm), sum(2 * len(view) for view in views)
    inverse, known = _inverse(system.reduced()[0]), p + q + POSE * len(views)
    covariance = inverse[:known, :known]
    residuals = [residual(state, nodes, view, shape, i) for i, view in enumerate(views)]
    chi_square = sum(float(np.sum(one**2)) for one in residuals)
    prior = np.concatenate([state.camera.beforehand, shape.prior_mm])
    held = float(np.sum(np.diag(covariance)[: p + q] / prior**2))
    variance = _errors_variance(system, inverse) if shape.node_mm.all() else np.zeros_like(nodes)
    free = float(np.sum(1 - variance / shape.node_mm**2)) - shape.similarity.shape[-1] if variance.any() else 0.0
    freedom = count - POSE * len(views) - (p + q - held) - free
    return Adjustment(state, covariance, variance, chi_square, freedom)


def _errors_variance(system: System, inverse: Array) -> Array:
    """Variances (N, 3) of the nodes' own errors."""
    K = system.solved(system.W)
    own = np.einsum("naa->na", np.linalg.inv(system.V))
    return np.asarray(own + np.einsum("nam,mk,nak->na", K, inverse, K, optimize=True))


def _moved(state: AdjustmentState, step: Array, errors: Array) -> AdjustmentState:
    """The state after a step of everything."""
    p, q = len(state.camera.params), len(state.terms_mm)
    changes = step[p + q : p + q + POSE * len(state.poses)].reshape(-1, POSE)
    turns = Rotation.from_rotvec(changes[:, :3]).as_matrix()
    poses = tuple(_turned(*one) for one in zip(state.poses, turns, changes[:, 3:], strict=True))
    camera = state.camera.with_params(state.camera.params + step[:p])
    return replace(
        state, camera=camera, poses=poses, terms_mm=state.terms_mm + step[p : p + q], errors_mm=state.errors_mm + errors
    )


def moved_pose(pose: Pose, change: Array) -> Pose:
    """The pose after a change (6,) in the camera's frame."""
    return _turned(pose, Rotation.from_rotvec(change[:3]).as_matrix(), change[3:])


def _turned(pose: Pose, turn: Array, shift: Array) -> Pose:
    return Pose(np.asarray(turn @ pose.R), np.asarray(turn @ pose.t + shift))


def residual(state: AdjustmentState, nodes: Array, view: ChartView, shape: ShapeModel, number: int) -> Array:
    """Where a view's nodes are seen less where they are put, in standard deviations, (n, 2)."""
    seen = state.camera.project(state.poses[number].apply(_shaped(state, nodes, view, shape)))
    return np.asarray(np.einsum("nab,nb->na", view.whitening, view.points - seen))


def _shaped(state: AdjustmentState, nodes: Array, view: ChartView, shape: ShapeModel) -> Array:
    """The nodes (n, 3) of a view, where the chart really has them."""
    return np.asarray(nodes[view.index] + _deviations(state, shape)[view.index])


@lru_cache(maxsize=2)
def _deviations(state: AdjustmentState, shape: ShapeModel) -> Array:
    """Of the state, kept: all views ask for the same."""
    return state.deviations_mm(shape)


def assemble(
    state: AdjustmentState,
    nodes: Array,
    views: Sequence[ChartView],
    shape: ShapeModel,
    extra: Sequence[Array] | None = None,
) -> System:
    """The normal equations of a state.

    Parameters
    ----------
    extra : sequence of (n, 2, k), optional
        Further unknowns that move the points of every view, in pixels.
    """
    residuals = [residual(state, nodes, view, shape, i) for i, view in enumerate(views)]
    return _with_prior(_of_points(state, nodes, views, shape, residuals, extra), state, shape)


def _of_points(
    state: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel, residuals: Sequence[Array],
    extra: Sequence[Array] | None = None,
) -> System:  # fmt: skip
    """The normal equations of residuals (n, 2) of every view's points, without what is known beforehand."""
    p, q, poses = len(state.camera.params), len(shape.prior_mm), POSE * len(views)
    k = extra[0].shape[-1] if extra else 0
    N, M = len(nodes), p + q + poses + k + shape.similarity.shape[-1]
    U, u, W = np.zeros((M, M)), np.zeros(M), np.zeros((N, 3, M))
    V, v = np.zeros((N, 3, 3)), np.zeros((N, 3))
    for i, (view, r) in enumerate(zip(views, residuals, strict=True)):
        J, E = jacobian(state, nodes, view, shape, i)
        if extra:
            J = np.concatenate([J, extra[i]], axis=-1)
        first = p + q + POSE * i
        places = np.r_[: p + q, first : first + POSE, p + q + poses : p + q + poses + k]
        add_view(J, E, r, view.whitening, view.index, places, V, v, W)
        flat = J.reshape(-1, J.shape[-1])
        U[np.ix_(places, places)] += flat.T @ flat
        u[places] += flat.T @ r.ravel()
    return System(U, u, V, v, W)


def _with_prior(system: System, state: AdjustmentState, shape: ShapeModel) -> System:
    """The system with what is known beforehand of the distortion and the chart's shape."""
    U, u, V, v, W = system.U, system.u, system.V, system.v, system.W
    precision = np.concatenate([state.camera.beforehand, shape.prior_mm]) ** -2.0
    values, where = np.concatenate([state.camera.params, state.terms_mm]), np.arange(len(precision))
    U[where, where] += precision
    u[where] -= precision * values
    if shape.node_mm.all():
        V[:, range(3), range(3)] += shape.node_mm**-2.0
        v -= state.errors_mm / shape.node_mm**2
        W[..., -shape.similarity.shape[-1] :] = shape.similarity
        u[-shape.similarity.shape[-1] :] = -np.einsum("nas,na->s", shape.similarity, state.errors_mm)
    else:  # no errors of their own: neither they nor the multipliers are moved by anything
        V[:], v[:], W[:] = np.eye(3), 0.0, 0.0
        last = np.arange(len(U) - shape.similarity.shape[-1], len(U))
        U[last, last] = 1.0
    return System(U, u, V, v, W)


def jacobian(
    state: AdjustmentState, nodes: Array, view: ChartView, shape: ShapeModel, number: int
) -> tuple[Array, Array]:
    """Derivatives of a view's points: (n, 2, p + q + 6) of camera, shape's terms and pose; (n, 2, 3) of the nodes."""
    pose = state.poses[number]
    points = pose.apply(_shaped(state, nodes, view, shape))
    by_points = state.camera.by_points(points)
    by_nodes = by_points @ pose.R
    by_terms = by_nodes @ shape.terms[view.index]
    return np.concatenate([state.camera.by_params(points), by_terms, by_pose(by_points, points)], axis=-1), by_nodes


def by_pose(by_points: Array, points: Array) -> Array:
    """Derivative (n, 2, 6) with a pose's change, from that with the points (n, 3) of the camera's frame."""
    x, y, z = points.T
    zero = np.zeros_like(x)
    # a turn by w moves X by w x X = -[X] w
    cross = np.stack([np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)], axis=-2)
    return np.concatenate([by_points @ cross, by_points], axis=-1)
