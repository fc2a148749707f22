"""Levenberg-Marquardt minimisation of a sum of squares, with second-order corrections along curved valleys.

At a state x with residuals r and Jacobian J (of the model, so that r changes by -J d) the step d solves

    (J'J + lambda D) d = J'r,    D = diag(J'J).

A step that raises the sum of squares is rejected and lambda raised; one that lowers it is taken and lambda lowered.
Where the sum falls by much less than the linear model predicts, the step follows the curve of the model,

    x + d + a / 2,    (J'J + lambda D) a = J' r'',

r'' being the second derivative of r along d, taken from differences (geodesic acceleration).

The minimum is reached when an undamped step would lower the sum by less than `tolerance` of it, or move the unknowns by
less than STEP_TOLERANCE of their size. A damped step is short by itself, so its length proves nothing; but where not
even the shortest lowers the sum, a residual with a kink has its minimum.

Source: Marquardt, An algorithm for least-squares estimation of nonlinear parameters, J. SIAM 11 (1963). Bates, Watts, A
relative offset orthogonality convergence criterion for nonlinear least squares, Technometrics 23, 1981. Transtrum,
Sethna, Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares minimization, 2012.
"""

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from scipy.linalg import LinAlgError

from procedures.numerics.arrays import Array

State = TypeVar("State")

MAX_ITERATIONS, MAX_REJECTIONS = 100, 10  # linearisations in all, and trial steps from one of them
STEP_TOLERANCE = 1e-9  # relative length of a step, both measured by D, that counts as none
LEAST_DAMPING, FIRST_DAMPING = 1e-13, 1e-10
"""The first lies below the eigenvalues of a scaled system that rounding leaves meaningful, and keeps a singular system
solvable; with the second a start near the minimum takes Gauss-Newton steps in all but the weakest directions."""
LOWER, RAISE = 0.1, 4.0
"""Factors of lambda after a step that was taken, and after the first that was rejected; each further one doubles it."""
POOR_GAIN = 0.5  # share of the predicted decrease below which a step is corrected to second order
ROUNDING = 1e-13  # relative decrease of a sum of squares that may be rounding
REACH = 0.1
"""Part of the step over which the second derivative is taken: large against rounding, small against third orders."""


class Linearisation(Protocol):
    """The model about a state."""

    @property
    def residual(self) -> Array:
        """Residuals (m,)."""

    @property
    def gradient(self) -> Array:
        """J'r, (n,)."""

    @property
    def scale(self) -> Array:
        """D (n,); 0 for unknowns that are not damped, such as Lagrange multipliers."""

    @property
    def unknowns(self) -> Array:
        """Values (n,), against which a step is short or long."""

    def transposed(self, residual: Array) -> Array:
        """J' times residuals (m,)."""

    def solve(self, right: Array, damping: float) -> Array:
        """(J'J + damping D)^-1 times (n,). May raise LinAlgError."""


class LeastSquares(Protocol[State]):
    """A least-squares problem: the sum of squares of `residual` is minimised."""

    def residual(self, state: State) -> Array:
        """Residuals (m,); not finite where the model has none."""

    def linearise(self, state: State) -> Linearisation:
        """The model about a state."""

    def moved(self, state: State, step: Array) -> State:
        """The state after a step (n,)."""


@dataclass(frozen=True, eq=False)
class Minimum(Generic[State]):
    """Result of the minimisation.

    cost : sum of squares
    iterations : linearisations
    decrease : by which share of it the last step lowered the sum of squares; 0 where none was taken
    """

    state: State
    cost: float
    iterations: int
    decrease: float
    converged: bool


def minimise(
    problem: LeastSquares[State], start: State, *, tolerance: float, limit: int = MAX_ITERATIONS
) -> Minimum[State]:
    """The minimum of a sum of squares near a start.

    tolerance : relative decrease of the sum of squares that is not worth another step. A sum over m residuals of known
        noise that is to be minimised to a thirtieth of a standard uncertainty needs 0.001 / m.
    limit : iterations at most
    """
    state, damping, decrease = start, FIRST_DAMPING, 0.0
    for iteration in range(1, limit + 1):
        model = problem.linearise(state)
        cost = _sum(model.residual)
        if not np.isfinite(cost):
            break
        step = _step(model, damping)
        # a damped step promises less and is shorter than the undamped one, which need not be computed where it is not
        if _is_small(model, step, damping, cost, tolerance):
            whole = _step(model, LEAST_DAMPING)
            if _is_small(model, whole, LEAST_DAMPING, cost, tolerance):
                last = _trial(problem, state, model, whole, LEAST_DAMPING)
                state, cost = (last.state, last.cost) if last.cost < cost else (state, cost)
                return Minimum(state, cost, iteration, decrease, True)
        trial, rejected = _trial(problem, state, model, step, damping), 0
        lower = (1 - ROUNDING) * cost
        while not trial.cost < lower and rejected < MAX_REJECTIONS:
            damping *= RAISE * 2.0**rejected
            rejected += 1
            trial = _trial(problem, state, model, _step(model, damping), damping)
        if not trial.cost < lower:
            # a minimum at a kink, which no undamped step reveals: even the shortest step was no descent
            return Minimum(state, cost, iteration, decrease, np.isfinite(trial.cost))
        state, decrease = trial.state, 1 - trial.cost / cost
        # a damping that was just too small is not tried again at once
        damping = max(damping * (LOWER if rejected == 0 else 1.0), LEAST_DAMPING)
    return Minimum(state, _sum(problem.residual(state)), iteration, decrease, False)


@dataclass(frozen=True, eq=False)
class _Trial(Generic[State]):
    state: State
    cost: float


def _sum(residual: Array) -> float:
    """Sum of squares, infinite where the model has no value."""
    total = float(residual @ residual)
    return total if np.isfinite(total) else np.inf


def _step(model: Linearisation, damping: float) -> Array:
    try:
        return model.solve(model.gradient, damping)
    except LinAlgError:
        return np.full_like(model.gradient, np.nan)


def _is_small(model: Linearisation, step: Array, damping: float, cost: float, tolerance: float) -> bool:
    """Whether the predicted decrease or the relative length of a step is negligible."""
    length, size = (float(np.sqrt(model.scale @ one**2)) for one in (step, model.unknowns))
    return _predicted(model, step, damping) <= tolerance * cost or length <= STEP_TOLERANCE * size


def _predicted(model: Linearisation, step: Array, damping: float) -> float:
    """Decrease of the sum of squares by a step if the model were linear."""
    return float(step @ (model.gradient + damping * model.scale * step))


def _trial(
    problem: LeastSquares[State], state: State, model: Linearisation, step: Array, damping: float
) -> _Trial[State]:
    """State after a damped step, corrected to second order where the straight one gains little."""
    if not np.isfinite(step).all():
        return _Trial(state, np.inf)
    cost, straight = _sum(model.residual), problem.moved(state, step)
    plain = _Trial(straight, _sum(problem.residual(straight)))
    if cost - plain.cost > POOR_GAIN * _predicted(model, step, damping):
        return plain
    ahead, behind = (problem.residual(problem.moved(state, sign * REACH * step)) for sign in (1, -1))
    second = (ahead - 2 * model.residual + behind) / REACH**2
    if not np.isfinite(second).all():
        return plain
    curved = problem.moved(state, step + model.solve(model.transposed(second), damping) / 2)
    corrected = _Trial(curved, _sum(problem.residual(curved)))
    return corrected if corrected.cost < plain.cost else plain
