"""Algorithm I on a small vibrating scene with a depth edge: properties of one restoration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.restoration.first_depth import initial_depth, segments
from procedures.restoration.joint import depth_edges, joint_descent
from procedures.restoration.joint.data_term import conjugate_gradients, restore_picture
from procedures.restoration.joint.gauss_newton import PriorWeights, joint_step
from procedures.restoration.joint.schedule import NEAR, Schedule, Scheme

from ..conftest import scene

SLOW_FIXTURES = {"restored"}


@pytest.fixture(scope="module")
def problem(vibrating):
    trust = np.ones((2, 1, *vibrating.z.shape[2:]))
    data, other = joint_descent.problem_of(vibrating.z, vibrating.stacks, trust, np.float32)
    scheme = Scheme(8, 6, 6, 2, 10)
    return joint_descent.JointProblem(data, other, scheme, Schedule(8), 0.0015, 12)


@pytest.fixture(scope="module")
def first(vibrating):
    return initial_depth.matched(vibrating.z, vibrating.stacks, np.full(2, 0.0015)).w


@pytest.fixture(scope="module")
def restored(problem, first):
    return joint_descent.run(problem, joint_descent.begin(problem, first))


def test_conjugate_gradients_solve_a_small_system(rng):
    a = rng.standard_normal((12, 12))
    A, b = a @ a.T + np.eye(12), rng.standard_normal(12)
    # n iterations solve n unknowns exactly except for rounding
    np.testing.assert_allclose(conjugate_gradients(lambda x: A @ x, b, 24), np.linalg.solve(A, b), rtol=1e-6)


def test_the_true_depth_restores_the_picture(vibrating, problem):
    problem.data.focus(vibrating.w.astype(np.float32))
    u = joint_descent.begin(problem, first_truth(vibrating)).u
    problem.data.focus(vibrating.w.astype(np.float32))
    u = restore_picture(problem.data, u, 3e-4, 40)
    assert vibrating.picture_error(u[:, 6:-6, 6:-6]) < 4


def first_truth(scene):
    return scene.w[6:-6, 6:-6]


def test_joint_steps_lower_the_cost_and_approach_the_true_depth(vibrating, problem, first, restored):
    state = joint_descent.begin(problem, first)
    weights = PriorWeights(1e-3, 0.05)
    before = joint_descent.cost(problem, state.u, state.w, weights)[0]
    u, w = joint_step(problem.data, state.u, state.w, weights, 12)
    assert joint_descent.cost(problem, u, w, weights)[0] < before
    problem.data.focus(vibrating.w.astype(np.float32))
    oracle = restore_picture(problem.data, joint_descent.begin(problem, first_truth(vibrating)).u, 3e-4, 60)
    best_error = vibrating.picture_error(oracle[:, 6:-6, 6:-6])
    assert vibrating.picture_error(restored.u[:, 6:-6, 6:-6]) < 1.6 * best_error
    assert vibrating.depth_error(restored.w[6:-6, 6:-6]) < vibrating.depth_error(first)
    assert vibrating.depth_error(restored.w[6:-6, 6:-6]) < 0.15


@pytest.mark.slow
def test_rounds_can_be_stopped_and_resumed(problem, first):
    running = joint_descent.rounds(problem, joint_descent.begin(problem, first))
    stopped, straight = next(running), next(running)
    resumed = next(joint_descent.rounds(problem, stopped))
    # the kernels' parallel sums have a fixed order, so the numbers are identical
    np.testing.assert_allclose(resumed.w, straight.w, atol=1e-4)


def test_every_round_is_reported(restored, problem):
    assert [r.n for r in restored.history] == [*range(8), 8]
    assert restored.history[0].what.startswith("steps far")
    assert all(r.seconds > 0 and np.isfinite(r.cost) for r in restored.history)


def test_edges_move_to_their_true_positions(vibrating, problem):
    R = vibrating.R
    displaced = vibrating.w.copy()
    displaced[:, 4:] = vibrating.w[:, :-4]  # the vertical edge four pixels to the right
    w = displaced.astype(np.float32)
    state = joint_descent.begin(problem, w[R:-R, R:-R])
    labels = segments.segments(state.w, 9, jump=0.35)
    layers = depth_edges.layers_of(state.w, labels, 10, 9, 0.35)
    _, placed, relabelled = depth_edges.place_steps(problem.data, problem.other, state.u, state.w, labels, layers, 1e-3)

    def wrong(w):
        return np.mean(np.abs(w - vibrating.w)[R:-R, R:-R] > 0.4)

    assert wrong(placed) < 0.4 * wrong(state.w)
    assert set(np.unique(relabelled)) <= set(np.unique(labels))


@pytest.mark.parametrize(("decided", "kept"), [(NEAR.decided, True), (1.0, False)])
def test_a_border_keeps_its_corner_where_the_share_is_decided(vibrating, problem, decided, kept):
    # the near square's corner: four of its nine neighbours and itself are near, so the median is far
    y, x = int(np.ceil(vibrating.w.shape[0] * 0.55)), int(vibrating.w.shape[1] * 0.5) + 1
    w = vibrating.w.astype(np.float32)
    problem.data.focus(w)
    u = restore_picture(problem.data, joint_descent.begin(problem, first_truth(vibrating)).u, 1e-4, 60)
    labels = segments.segments(w, 3, jump=0.35)
    layers = depth_edges.layers_of(w, labels, 3, 1, 0.35)
    placed = depth_edges.place_steps(problem.data, problem.other, u, w, labels, layers, 1e-4, decided=decided)[1]
    assert vibrating.w[y, x] - vibrating.w[y - 1, x - 1] > 0.8
    assert (abs(placed[y, x] - vibrating.w[y, x]) < 0.3) == kept


@pytest.mark.slow
def test_the_depth_prior_yields_to_a_smeared_step_under_strong_noise(vibration_stacks):
    noisy = scene(vibration_stacks, (96, 112), 20.0, seed=4)
    data, other = joint_descent.problem_of(noisy.z, noisy.stacks, np.ones((2, 1, 96, 112)), np.float32)
    problem = joint_descent.JointProblem(
        data, other, Scheme(20, 10, 10, 1, 20), Schedule(20), 0.1 * float(noisy.z.std()), reach=12
    )
    # after the last localisation only descent changes the depth
    state = replace(joint_descent.begin(problem, gaussian_filter(noisy.w, 5)[6:-6, 6:-6]), n=14)
    yielding = joint_descent.run(problem, state)
    stiff = joint_descent.run(replace(problem, yielding=0), state)
    inside = np.s_[..., 6:-6, 6:-6]
    assert noisy.depth_error(yielding.w[inside]) < 0.97 * noisy.depth_error(stiff.w[inside])
    assert noisy.picture_error(yielding.u[inside]) < 0.97 * noisy.picture_error(stiff.u[inside])


def test_weak_priors_and_missing_edges_change_nothing(problem, first):
    state, weights = joint_descent.begin(problem, first), PriorWeights(1e-3, 0.05)
    before = joint_descent.cost(problem, state.u, state.w, weights)
    assert joint_descent.cost(replace(problem, yielding=0), state.u, state.w, weights) == before
    w = np.full((40, 40), 2.0)
    labels = segments.segments(w, 3, jump=0.35)
    assert labels.max() == 1
    assert not depth_edges.layers_of(w, labels, 5, 3, 0.35).band.any()
