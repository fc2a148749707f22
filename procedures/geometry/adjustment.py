"""Least-squares adjustment of camera, poses and chart shape, with their joint covariance.

pycolmap supports neither covariances of points nor priors on the shape of a chart, so the final adjustment uses the
Levenberg-Marquardt method of `procedures.numerics.damped` to minimise

    sum |W (project(R (X + B c + e) + t) - x)|^2 + sum (c / prior)^2 + sum (e / node)^2 + sum (k / prior)^2

over the camera parameters k, the poses, the shape terms c, and an error e of every node. The normal equations couple
the errors of different nodes only through the other unknowns. They are eliminated node by node (the Schur complement of
bundle adjustment), which leaves a small dense system. A rigid motion or a scaling of all nodes is equivalent to another
pose or scale; seven Lagrange multipliers exclude it from e.

Source: Triggs, McLauchlan, Hartley, Fitzgibbon, Bundle adjustment: a modern synthesis, 2000, section 6.1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from procedures.geometry.cameras import CameraModel
from procedures.geometry.node_kernels import add_view
from procedures.geometry.shape import ShapeModel
from procedures.geometry.views import ChartView, Pose
from procedures.numerics.arrays import Array, Indices
from procedures.numerics.damped import minimise
from procedures.outcome import Refused

CONVERGENCE_TOLERANCE = 1e-3
"""Decrease of chi-square, relative to its mean per coordinate, at convergence: 1/30 of a standard uncertainty."""
LEAST_EIGENVALUE = 1e-15  # eigenvalue of the scaled system below which rounding dominates
POSE = 6  # parameters of a change of pose: rotation (3) about the camera's axes in radians, then translation (3) in mm


@dataclass(frozen=True, eq=False)
class AdjustmentState:
    """Camera, or cameras, poses of the chart in the camera of every view, and the shape of the chart.

    terms_mm : (q,) float64, shape terms
    errors_mm : (N, 3) float64, error of each node in addition to the terms
    """

    camera: CameraModel
    poses: tuple[Pose, ...]
    terms_mm: Array
    errors_mm: Array

    def deviations_mm(self, shape: ShapeModel) -> Array:
        """Deviation of every node from the plan, (N, 3)."""
        return np.asarray(shape.terms @ self.terms_mm + self.errors_mm)


@dataclass(frozen=True, eq=False)
class System:
    """The normal equations at a state, before elimination of the node errors.

    The first M unknowns are the camera parameters (p), the shape terms (q), six per pose, further unknowns, and the
    multipliers; each node has three more.

    U : (M, M), u : (M,) J'J and J'r of the first unknowns
    V : (N, 3, 3), v : (N, 3) J'J and J'r of the node errors
    W : (N, 3, M) J'J between node errors and first unknowns
    """

    U: Array
    u: Array
    V: Array
    v: Array
    W: Array

    @property
    def right(self) -> Array:
        """u and v concatenated."""
        return np.concatenate([self.u, self.v.ravel()])

    def reduced(self) -> tuple[Array, Array]:
        """Matrix and right side for the first unknowns after elimination of the node errors."""
        # with V = L L', W'V^-1 W is the square of L^-1 W: half the work of a product of two matrices
        inverse = np.linalg.inv(np.linalg.cholesky(self.V))
        root, right = (inverse @ self.W).reshape(-1, len(self.u)), (inverse @ self.v[..., None]).ravel()
        return self.U - root.T @ root, self.u - root.T @ right

    def errors(self, step: Array) -> Array:
        """Step (N, 3) of the node errors for a step of the first unknowns."""
        return self.solved((self.v - self.W @ step)[..., None])[..., 0]

    def solved(self, right: Array) -> Array:
        """V^-1 times (N, 3, k); 0 for nodes without an error."""
        return np.asarray(np.linalg.solve(self.V, right))


@dataclass(frozen=True, eq=False)
class AdjustmentProblem:
    """The least-squares problem: views of a chart, its plan, and the prior of its shape.

    nodes : (N, 3) float64, the plan of the chart, in mm
    """

    nodes: Array
    views: Sequence[ChartView]
    shape: ShapeModel

    def flat_state(self, camera: CameraModel, poses: tuple[Pose, ...]) -> AdjustmentState:
        """State with a chart that conforms to its plan."""
        return AdjustmentState(camera, poses, np.zeros(len(self.shape.prior_mm)), np.zeros_like(self.nodes))

    def view_residual(self, state: AdjustmentState, i: int) -> Array:
        """Observed minus projected points of a view, in standard deviations, (n, 2)."""
        view = self.views[i]
        projected = state.camera.part(view.camera)[0].project(self.placed(state, i))
        return np.asarray(np.einsum("nab,nb->na", view.whitening, view.points - projected))

    def view_residuals(self, state: AdjustmentState) -> list[Array]:
        """Residuals of every view."""
        return [self.view_residual(state, i) for i in range(len(self.views))]

    def residual(self, state: AdjustmentState) -> Array:
        """Residuals of all points, then of the priors."""
        prior = (state.camera.prior @ state.camera.params, state.terms_mm / self.shape.prior_mm)
        errors = state.errors_mm / self.shape.node_mm if self.shape.node_mm.all() else np.zeros(0)
        points = (one.ravel() for one in self.view_residuals(state))
        return np.concatenate([*points, *prior, errors.ravel()])

    def prior_precision(self, state: AdjustmentState) -> Array:
        """Precision (p + q, p + q) of the priors of camera parameters and shape terms."""
        return np.asarray(block_diag(state.camera.information, np.diag(self.shape.prior_mm**-2.0)))

    def linearise(self, state: AdjustmentState) -> "_ChartLinearisation":
        return _ChartLinearisation(state, self, self.residual(state))

    def moved(self, state: AdjustmentState, step: Array) -> AdjustmentState:
        """The state after a step of the first unknowns, then of the node errors."""
        p, q, poses = len(state.camera.params), len(state.terms_mm), POSE * len(state.poses)
        changes = step[p + q : p + q + poses].reshape(-1, POSE)
        turns = Rotation.from_rotvec(changes[:, :3]).as_matrix()
        return AdjustmentState(
            state.camera.with_params(state.camera.params + step[:p]),
            tuple(_turned(*one) for one in zip(state.poses, turns, changes[:, 3:], strict=True)),
            state.terms_mm + step[p : p + q],
            state.errors_mm + step[-self.nodes.size :].reshape(-1, 3),
        )

    def jacobian(self, state: AdjustmentState, i: int) -> tuple[Array, Array]:
        """Derivatives of a view's points: (n, 2, p + q + 6) by its camera, shape terms, pose; (n, 2, 3) by nodes."""
        pose, view = state.poses[i], self.views[i]
        camera, points = state.camera.part(view.camera)[0], self.placed(state, i)
        by_points = camera.by_points(points)
        by_nodes = by_points @ pose.R
        by_terms = by_nodes @ self.shape.terms[view.index]
        return np.concatenate([camera.by_params(points), by_terms, by_pose(by_points, points)], -1), by_nodes

    def places(self, state: AdjustmentState, i: int) -> Indices:
        """Indices of a view's camera, shape terms and pose among the unknowns."""
        p, shared = len(state.camera.params), len(state.camera.params) + len(state.terms_mm)
        first, own = shared + POSE * i, state.camera.part(self.views[i].camera)[1]
        places: Indices = np.r_[own, p:shared, first : first + POSE]
        return places

    def placed(self, state: AdjustmentState, i: int) -> Array:
        """Positions (n, 3) of a view's nodes in its camera's frame."""
        return state.poses[i].apply(self.shaped(state, self.views[i]))

    def still(self, state: AdjustmentState, i: int) -> ChartView:
        """A view with all points at one time."""
        return self.views[i]

    def shaped(self, state: AdjustmentState, view: ChartView) -> Array:
        """Actual positions (n, 3) of a view's nodes on the chart."""
        return np.asarray(self.nodes[view.index] + _deviations(state, self.shape)[view.index])

    def system(self, state: AdjustmentState, extra: Sequence[Array] | None = None) -> System:
        """The normal equations with the priors.

        extra : sequence of (n, 2, k), derivatives of the points of every view, in pixels, by k further unknowns
        """
        system, shape = self.point_system(state, self.view_residuals(state), extra), self.shape
        U, u, V, v, W = system.U, system.u, system.V, system.v, system.W
        precision = self.prior_precision(state)
        known = slice(len(precision))
        U[known, known] += precision
        u[known] -= precision @ np.concatenate([state.camera.params, state.terms_mm])
        multipliers = shape.similarity.shape[-1]
        if shape.node_mm.all():
            V[:, range(3), range(3)] += shape.node_mm**-2.0
            v -= state.errors_mm / shape.node_mm**2
            W[..., -multipliers:] = shape.similarity
            u[-multipliers:] = -np.einsum("nas,na->s", shape.similarity, state.errors_mm)
        else:  # without node errors, neither these nor the multipliers are coupled to anything
            V[:], v[:], W[:] = np.eye(3), 0.0, 0.0
            last = np.arange(len(U) - multipliers, len(U))
            U[last, last] = 1.0
        return system

    def point_system(
        self, state: AdjustmentState, residuals: Sequence[Array], extra: Sequence[Array] | None = None
    ) -> System:
        """The normal equations for residuals (n, 2) of the points of every view, without the priors."""
        p, q, poses = len(state.camera.params), len(self.shape.prior_mm), POSE * len(self.views)
        k = extra[0].shape[-1] if extra else 0
        N, M = len(self.nodes), p + q + poses + k + self.shape.similarity.shape[-1]
        U, u, W = np.zeros((M, M)), np.zeros(M), np.zeros((N, 3, M))
        V, v = np.zeros((N, 3, 3)), np.zeros((N, 3))
        for i, (view, r) in enumerate(zip(self.views, residuals, strict=True)):
            J, E = self.jacobian(state, i)
            if extra:
                J = np.concatenate([J, extra[i]], axis=-1)
            places = np.r_[self.places(state, i), p + q + poses : p + q + poses + k]
            used = J.any(axis=(0, 1))  # a view shows few control points of a spline
            J, places = np.compress(used, J, axis=-1), places[used]
            add_view(J, E, r, view.whitening, view.index, places, V, v, W)
            flat = J.reshape(-1, J.shape[-1])
            U[np.ix_(places, places)] += flat.T @ flat
            u[places] += flat.T @ r.ravel()
        return System(U, u, V, v, W)


@lru_cache(maxsize=2)
def _deviations(state: AdjustmentState, shape: ShapeModel) -> Array:
    """Deviations of the nodes, cached since every view needs them."""
    return state.deviations_mm(shape)


@dataclass(frozen=True, eq=False)
class ModelDiscrepancy:
    """Independent errors of one standard deviation each, by terms that a camera model does not have.

    unknowns : (j, known) float64, errors of the unknowns of the adjustment, in the order of its covariance
    terms : (j, k) float64, the missing terms, in the order of `model_discrepancy.missing_terms`
    """

    unknowns: Array
    terms: Array


@dataclass(frozen=True, eq=False)
class ExtraTerms:
    """The normal equations of further unknowns after elimination of all others.

    matrix : (k, k), right : (k,) information and right side
    response : (known, k) change of the other unknowns per unit of the further ones
    """

    matrix: Array
    right: Array
    response: Array


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The result, with its covariance for the stated covariances of the points.

    covariance : (p + q + 6 views, p + q + 6 views) float64
        Of the camera parameters, the shape terms, and the changes of the poses, in this order.
    errors_variance : (N, 3) float64, of the node errors, in square mm
    chi_square : float, of the points alone
    freedom : float
        Degrees of freedom: coordinates minus fitted parameters, each counted as far as the points determine it.
    discrepancy : ModelDiscrepancy or None, effect of terms that the camera model does not have
    """

    problem: AdjustmentProblem
    state: AdjustmentState
    covariance: Array
    errors_variance: Array
    chi_square: float
    freedom: float
    discrepancy: ModelDiscrepancy | None = None

    @property
    def scale(self) -> float:
        """Residual in units of the stated standard deviations: 1 for a correct model."""
        return float(np.sqrt(self.chi_square / self.freedom))

    @property
    def full_covariance(self) -> Array:
        """Covariance of the unknowns, scaled by the square of the residual, with the model discrepancy."""
        covariance = self.covariance * self.scale**2
        if self.discrepancy is None:
            return covariance
        return covariance + self.discrepancy.unknowns.T @ self.discrepancy.unknowns

    @property
    def shared(self) -> int:
        """Number of camera parameters and shape terms; the poses follow in the covariance."""
        return len(self.state.camera.params) + len(self.state.terms_mm)


def extra_terms(fit: Adjustment, extra: Sequence[Array]) -> ExtraTerms:
    """Further unknowns at the state of an adjustment, by derivatives (n, 2, k) of every view's points, in pixels."""
    S, b = fit.problem.system(fit.state, extra).reduced()
    known, k = len(fit.covariance), extra[0].shape[-1]
    new = (np.arange(len(S)) >= known) & (np.arange(len(S)) < known + k)
    cross = S[np.ix_(~new, new)]
    eliminated = np.linalg.solve(S[np.ix_(~new, ~new)], np.column_stack([cross, b[~new]]))
    matrix, right = S[np.ix_(new, new)] - cross.T @ eliminated[:, :-1], b[new] - cross.T @ eliminated[:, -1]
    return ExtraTerms(matrix, right, -eliminated[:known, :-1])


class NotConverged(Refused):
    """The adjustment did not converge: a numerical failure, which implies nothing about the views."""


def adjust(start: AdjustmentState, problem: AdjustmentProblem) -> Adjustment:
    """The adjustment from an initial state.

    Raises NotConverged if the minimum is not reached, Refused if the views do not determine the camera.
    """
    state = adjusted(start, problem)
    views, shape, system = problem.views, problem.shape, problem.system(state)
    p, q, count = len(state.camera.params), len(shape.prior_mm), sum(2 * len(view) for view in views)
    inverse, known = _inverse(system.reduced()[0]), p + q + POSE * len(views)
    covariance = inverse[:known, :known]
    chi_square = sum(float(np.sum(residual**2)) for residual in problem.view_residuals(state))
    held = float(np.sum(covariance[: p + q, : p + q] * problem.prior_precision(state)))
    variance = np.zeros_like(problem.nodes)  # of the node errors
    if shape.node_mm.all():
        K, own = system.solved(system.W), np.einsum("naa->na", np.linalg.inv(system.V))
        variance = own + np.einsum("nam,mk,nak->na", K, inverse, K, optimize=True)
    free = float(np.sum(1 - variance / shape.node_mm**2)) - shape.similarity.shape[-1] if variance.any() else 0.0
    freedom = count - POSE * len(views) - (p + q - held) - free
    return Adjustment(problem, state, covariance, variance, chi_square, freedom)


def adjusted(
    start: AdjustmentState, problem: AdjustmentProblem, tolerance: float = CONVERGENCE_TOLERANCE
) -> AdjustmentState:
    """The state of the adjustment, without covariances. Raises NotConverged if the minimum is not reached."""
    fit = minimise(problem, start, tolerance=tolerance / sum(2 * len(view) for view in problem.views))
    if not fit.converged:
        raise NotConverged(
            f"the adjustment of camera and poses must converge; with {start.camera.model} it did not in "
            f"{fit.iterations} iterations; the last relative decrease of the sum of squares was {fit.decrease:.1e}",
            "name a simpler camera model, or add views of the chart, tilted differently and spread over the frame",
        )
    return fit.state


@dataclass(frozen=True, eq=False)
class _ChartLinearisation:
    """The normal equations at a state, solved by elimination of the node errors."""

    state: AdjustmentState
    problem: AdjustmentProblem
    residual: Array

    @cached_property
    def _system(self) -> System:
        return self.problem.system(self.state)

    @property
    def gradient(self) -> Array:
        return self._system.right

    @cached_property
    def scale(self) -> Array:
        """Diagonal of J'J; 0 for the multipliers, which do not enter the sum of squares."""
        first = np.diag(self._system.U).copy()
        first[-self.problem.shape.similarity.shape[-1] :] = 0.0
        return np.concatenate([first, np.einsum("naa->na", self._system.V).ravel()])

    @property
    def unknowns(self) -> Array:
        """Values of the unknowns; for a pose, its distance."""
        state, count = self.state, self.problem.shape.similarity.shape[-1]
        poses = [np.concatenate([np.zeros(3), pose.t]) for pose in state.poses]
        return np.concatenate([state.camera.params, state.terms_mm, *poses, np.zeros(count), state.errors_mm.ravel()])

    def transposed(self, residual: Array) -> Array:
        """J' times residuals; those of the priors are linear and have no second derivative."""
        problem, first = self.problem, 0
        right = np.zeros(len(self._system.right))
        of_nodes = right[len(self._system.u) :].reshape(-1, 3)
        for i, view in enumerate(problem.views):
            r = residual[first : first + 2 * len(view)].reshape(-1, 1, 2) @ view.whitening
            J, E = problem.jacobian(self.state, i)
            right[problem.places(self.state, i)] += r.ravel() @ J.reshape(r.size, -1)
            of_nodes[view.index] += (r @ E)[:, 0]
            first += r.size
        return right

    def solve(self, right: Array, damping: float) -> Array:
        system = self._system
        M = len(system.u)
        damped = replace(
            system,
            U=system.U + damping * np.diag(self.scale[:M]),
            V=system.V + damping * system.V * np.eye(3),
            u=right[:M],
            v=right[M:].reshape(-1, 3),
        )
        S, b = damped.reduced()
        scale = np.sqrt(np.abs(np.diag(S)))
        step = np.asarray(np.linalg.solve(S / np.outer(scale, scale), b / scale) / scale)
        return np.concatenate([step, damped.errors(step).ravel()])


def _inverse(S: Array) -> Array:
    """Covariance of the unknowns. Raises Refused where the views leave some of them undetermined."""
    scale = np.sqrt(np.abs(np.diag(S)))
    values, vectors = np.linalg.eigh(S / np.outer(scale, scale))
    if np.abs(values).min() < LEAST_EIGENVALUE or np.count_nonzero(values < 0) != np.count_nonzero(np.diag(S) < 0):
        raise Refused(
            "these views do not determine the camera", "tilt the chart by 20 degrees and more, and fill the frame"
        )
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))


def moved_pose(pose: Pose, change: Array) -> Pose:
    """The pose after a change (6,) in the camera's frame."""
    return _turned(pose, Rotation.from_rotvec(change[:3]).as_matrix(), change[3:])


def _turned(pose: Pose, turn: Array, shift: Array) -> Pose:
    return Pose(np.asarray(turn @ pose.R), np.asarray(turn @ pose.t + shift))


def by_pose(by_points: Array, points: Array) -> Array:
    """Derivative (n, 2, 6) by a change of pose, from that by the points (n, 3) in the camera's frame."""
    # a turn by w moves X by w x X = -[X] w
    cross = np.cross(np.eye(3), points[:, None, :]).swapaxes(-1, -2)
    return np.concatenate([by_points @ cross, by_points], axis=-1)
