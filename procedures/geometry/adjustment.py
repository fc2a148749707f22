"""Camera, poses and the chart's own shape together, every point weighing what it is worth, with one covariance.

pycolmap knows neither the points' covariances nor what is known beforehand of a chart's shape, so this last adjustment
is our own: Gauss-Newton steps on

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
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from procedures.geometry.cameras import Camera
from procedures.geometry.node_kernels import add_view
from procedures.geometry.shape import ShapeModel
from procedures.geometry.views import ChartView, Pose
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]

STEPS, SHORTER = 40, 4.0
"""Steps at most; by how much one that leads uphill is shortened, and the next ones grow again."""
STILL = 1e-3
"""A step that promises to lower the sum of squares by less is the last: a thirtieth of an uncertainty is left."""
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
    chi_square : float
        Of the residual and of what is known beforehand.
    """

    U: Array
    u: Array
    V: Array
    v: Array
    W: Array
    chi_square: float

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
    Refused
        If the views do not determine the camera, or the steps come to no end.
    """
    state, share = start, 1.0
    system = assemble(state, nodes, views, shape)
    step, errors, promised = _step(system)
    for _ in range(STEPS):
        better = _moved(state, share * step, share * errors)
        if not _chi_square(better, nodes, views, shape) < system.chi_square + STILL:
            share /= SHORTER
            continue
        state, system = better, assemble(better, nodes, views, shape)
        if share == 1 and promised < STILL:
            return _concluded(state, nodes, views, shape, system)
        share = min(1.0, SHORTER * share)
        step, errors, promised = _step(system)
    raise _restless()


def _restless() -> Refused:
    return Refused(
        f"the adjustment of camera and poses came to no rest in {STEPS} steps",
        "add views of the chart, tilted differently and spread over the frame",
    )


def _step(system: System) -> tuple[Array, Array, float]:
    """The step of the first unknowns, that of the nodes' errors, and by how much they promise to lower chi-square."""
    if not np.isfinite(system.chi_square):
        raise _restless()
    S, b = system.reduced()
    step = _solve(S, b)
    return step, system.errors(step), float(step @ b)


def _chi_square(state: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel) -> float:
    """What the system of a state has, without the system."""
    squares = (float(np.sum(residual(state, nodes, view, shape, i) ** 2)) for i, view in enumerate(views))
    return sum(squares) + _known_beforehand(state, shape)


def _known_beforehand(state: AdjustmentState, shape: ShapeModel) -> float:
    """The part of chi-square that does not come from points."""
    spread = np.concatenate([state.camera.beforehand, shape.prior_mm])
    held = float(np.sum((np.concatenate([state.camera.params, state.terms_mm]) / spread) ** 2))
    return held + (float(np.sum((state.errors_mm / shape.node_mm) ** 2)) if shape.node_mm.all() else 0.0)


def _solve(S: Array, b: Array) -> Array:
    """The step, in unknowns that are scaled so that each is worth about as much."""
    scale = np.sqrt(np.abs(np.diag(S)))
    try:
        return np.asarray(np.linalg.solve(S / np.outer(scale, scale), b / scale) / scale)
    except np.linalg.LinAlgError as error:
        raise _undetermined() from error


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
    p, q, poses = len(state.camera.params), len(shape.prior_mm), POSE * len(views)
    k = extra[0].shape[-1] if extra else 0
    N, M = len(nodes), p + q + poses + k + shape.similarity.shape[-1]
    U, u, W = np.zeros((M, M)), np.zeros(M), np.zeros((N, 3, M))
    V, v = np.zeros((N, 3, 3)), np.zeros((N, 3))
    chi_square = 0.0
    for i, view in enumerate(views):
        r = residual(state, nodes, view, shape, i)
        J, E = jacobian(state, nodes, view, shape, i)
        if extra:
            J = np.concatenate([J, extra[i]], axis=-1)
        first = p + q + POSE * i
        places = np.r_[: p + q, first : first + POSE, p + q + poses : p + q + poses + k]
        add_view(J, E, r, view.whitening, view.index, places, V, v, W)
        flat = J.reshape(-1, J.shape[-1])
        U[np.ix_(places, places)] += flat.T @ flat
        u[places] += flat.T @ r.ravel()
        chi_square += float(np.sum(r**2))
    return _with_prior(System(U, u, V, v, W, chi_square), state, shape)


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
    return System(U, u, V, v, W, system.chi_square + _known_beforehand(state, shape))


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
