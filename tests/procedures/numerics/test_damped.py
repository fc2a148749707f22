from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve

from procedures.numerics.damped import minimise


@dataclass(frozen=True, eq=False)
class DenseLinearisation:
    """The model of few unknowns, its Jacobian (m, n) written out."""

    unknowns: np.ndarray
    residual: np.ndarray
    J: np.ndarray

    @property
    def gradient(self) -> np.ndarray:
        return self.transposed(self.residual)

    @property
    def scale(self) -> np.ndarray:
        return np.sum(self.J**2, axis=0)

    def transposed(self, residual: np.ndarray) -> np.ndarray:
        return np.asarray(self.J.T @ residual)

    def solve(self, right: np.ndarray, damping: float) -> np.ndarray:
        root = np.sqrt(self.scale)
        root[root == 0] = 1.0
        scaled = self.J / root
        system = scaled.T @ scaled + damping * np.eye(len(root))
        return np.asarray(cho_solve(cho_factor(system), right / root) / root)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals r(x), and the derivative of the model, -dr/dx."""

    r: Callable[[np.ndarray], np.ndarray]
    J: Callable[[np.ndarray], np.ndarray]

    def residual(self, state):
        with np.errstate(all="ignore"):
            return np.asarray(self.r(state), dtype=np.float64)

    def linearise(self, state):
        return DenseLinearisation(state, self.residual(state), np.asarray(self.J(state), dtype=np.float64))

    def moved(self, state, step):
        return state + step


ROSENBROCK = Residuals(
    lambda p: np.array([10 * (p[1] - p[0] ** 2), 1 - p[0]]), lambda p: np.array([[20 * p[0], -10.0], [1.0, 0.0]])
)


T = np.linspace(0, 5, 40)
DECAY = Residuals(
    lambda p: 3 * np.exp(-0.7 * T) - p[0] * np.exp(-p[1] * T),
    lambda p: np.column_stack([np.exp(-p[1] * T), -p[0] * T * np.exp(-p[1] * T)]),
)
LOGARITHM = Residuals(lambda p: np.log(p), lambda p: np.diag(-1 / p))


@pytest.mark.delicate
@pytest.mark.parametrize(
    ("problem", "start", "end", "costs"),
    [
        (ROSENBROCK, [-1.2, 1.0], [1, 1], [24.2, 2.61389e-11]),
        (DECAY, [0.5, 3.0], [3, 0.7], [47.2591, 33.7609, 18.7933, 7.94174, 0.593187, 0.00155239]),
        # Newton's first step leads to -13, where there is no logarithm
        (LOGARITHM, [10.0], [1], [5.3019, 2.46663, 1.28486, 0.521436, 0.0370889, 0.000289505]),
    ],
    ids=["a valley", "a decay", "steps to where there is no residual"],
)
def test_descent_takes_the_steps_that_it_took(problem, start, end, costs):
    sums = []

    class Watched(Residuals):
        def linearise(self, state):
            sums.append(float(np.sum(self.residual(state) ** 2)))
            return super().linearise(state)

    found = minimise(Watched(problem.r, problem.J), np.array(start), tolerance=1e-12)
    assert found.converged
    assert found.iterations == len(sums) < 10
    # the steps end below 1e-9 of the unknowns
    np.testing.assert_allclose(found.state, end, rtol=1e-8)
    np.testing.assert_allclose(sums[: len(costs)], costs, rtol=1e-3)
    assert np.all(np.diff(sums) < 0)


def test_a_linear_problem_is_solved_by_its_normal_equations(rng):
    A, y = rng.standard_normal((30, 4)), rng.standard_normal(30)
    found = minimise(Residuals(lambda x: y - A @ x, lambda x: A), np.zeros(4), tolerance=1e-12)
    assert found.converged
    assert found.iterations <= 2
    # least squares' own normal equations lose the square of the condition, about 10
    np.testing.assert_allclose(found.state, np.linalg.lstsq(A, y, rcond=None)[0], atol=1e-12)


@pytest.mark.delicate
def test_what_the_residuals_leave_open_does_not_move_the_rest(rng):
    # only x + y and z are determined: the damping decides x - y, and leaves it where it was
    A, y = rng.standard_normal((20, 2)), rng.standard_normal(20)
    to_sum = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    start = np.array([2.0, -1.0, 0.0])
    found = minimise(Residuals(lambda x: y - A @ to_sum @ x, lambda x: A @ to_sum), start, tolerance=1e-12)
    assert found.converged
    # eigenvalues beside LEAST_DAMPING, 1e-13 of them, are off by their rounding, 1e-16 over it
    np.testing.assert_allclose(to_sum @ found.state, np.linalg.lstsq(A, y, rcond=None)[0], rtol=1e-6)
    assert found.state[0] - found.state[1] == pytest.approx(3, abs=1e-2)


def test_a_minimum_is_kept_at_a_kink_and_reported_where_it_is_not_reached():
    found = minimise(ROSENBROCK, np.array([-1.2, 1.0]), tolerance=1e-12, limit=2)
    assert (found.converged, found.iterations) == (False, 2)
    assert 0 < found.decrease < 1
    found = minimise(ROSENBROCK, np.array([1.0, 1.0]), tolerance=1e-12)
    assert (found.converged, found.iterations) == (True, 1)
    np.testing.assert_array_equal(found.state, 1)
    assert not minimise(LOGARITHM, np.array([-1.0]), tolerance=1e-12).converged
    # |x| + 1 where it falls steeply on one side and slowly on the other: the slope never vanishes
    kinked = Residuals(
        lambda p: np.array([1 + np.where(p[0] > 0, p[0], -3 * p[0])]), lambda p: np.array([[-1.0 if p[0] > 0 else 3.0]])
    )
    found = minimise(kinked, np.array([2.0]), tolerance=1e-9)
    assert found.converged
    assert found.state[0] == pytest.approx(0, abs=1e-6)
