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


@pytest.mark.delicate
def test_rosenbrocks_valley_is_followed_to_its_end():
    found = minimise(ROSENBROCK, np.array([-1.2, 1.0]), tolerance=1e-12)
    assert found.converged
    # the steps end below 1e-9 of the unknowns
    np.testing.assert_allclose(found.state, 1, rtol=1e-8)
    assert found.iterations < 20


def test_a_linear_problem_is_solved_by_its_normal_equations(rng):
    A, y = rng.standard_normal((30, 4)), rng.standard_normal(30)
    found = minimise(Residuals(lambda x: y - A @ x, lambda x: A), np.zeros(4), tolerance=1e-12)
    assert found.converged
    assert found.iterations <= 2
    # least squares' own normal equations lose the square of the condition, about 10
    np.testing.assert_allclose(found.state, np.linalg.lstsq(A, y, rcond=None)[0], atol=1e-12)


@pytest.mark.delicate
def test_an_exponential_decay_is_found_from_far(rng):
    t = np.linspace(0, 5, 40)
    found = minimise(
        Residuals(
            lambda p: 3 * np.exp(-0.7 * t) - p[0] * np.exp(-p[1] * t),
            lambda p: np.column_stack([np.exp(-p[1] * t), -p[0] * t * np.exp(-p[1] * t)]),
        ),
        np.array([0.5, 3.0]),
        tolerance=1e-12,
    )
    assert found.converged
    np.testing.assert_allclose(found.state, [3, 0.7], rtol=1e-8)


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


def test_no_step_raises_the_sum_of_squares():
    sums = []

    def r(p):
        return np.array([10 * (p[1] - p[0] ** 2), 1 - p[0]])

    class Watched(Residuals):
        def linearise(self, state):
            sums.append(float(np.sum(r(state) ** 2)))
            return super().linearise(state)

    minimise(Watched(r, ROSENBROCK.J), np.array([-1.2, 1.0]), tolerance=1e-12)
    assert np.all(np.diff(sums) < 0)


def test_a_minimum_that_is_not_reached_is_reported_as_such():
    found = minimise(ROSENBROCK, np.array([-1.2, 1.0]), tolerance=1e-12, limit=2)
    assert (found.converged, found.iterations) == (False, 2)
    assert 0 < found.decrease < 1


def test_a_start_at_the_minimum_stays_there():
    found = minimise(ROSENBROCK, np.array([1.0, 1.0]), tolerance=1e-12)
    assert (found.converged, found.iterations) == (True, 1)
    np.testing.assert_array_equal(found.state, 1)


def test_a_start_without_a_residual_is_no_minimum():
    nowhere = Residuals(lambda p: np.log(p), lambda p: np.diag(-1 / p))
    found = minimise(nowhere, np.array([-1.0]), tolerance=1e-12)
    assert not found.converged


def test_steps_to_where_there_is_no_residual_are_shortened():
    # Newton's first step for log x = 0 from x = 10 leads to -13
    found = minimise(Residuals(lambda p: np.log(p), lambda p: np.diag(-1 / p)), np.array([10.0]), tolerance=1e-12)
    assert found.converged
    assert found.state[0] == pytest.approx(1, abs=1e-8)


def test_the_minimum_at_a_kink_is_one():
    # |x| + 1 where it falls steeply on one side and slowly on the other: the slope never vanishes
    kinked = Residuals(
        lambda p: np.array([1 + np.where(p[0] > 0, p[0], -3 * p[0])]), lambda p: np.array([[-1.0 if p[0] > 0 else 3.0]])
    )
    found = minimise(kinked, np.array([2.0]), tolerance=1e-9)
    assert found.converged
    assert found.state[0] == pytest.approx(0, abs=1e-6)
