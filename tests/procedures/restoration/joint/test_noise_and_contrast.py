"""Noise and contrast told from a restoration, against the truth and against solving for random photographs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.restoration.joint import joint_descent, noise_and_contrast
from procedures.restoration.joint.data_term import DataTerm, conjugate_gradients, restore_picture
from procedures.restoration.joint.gauss_newton import PriorWeights
from procedures.restoration.masks.array_loops import add_bending, add_diffusion


@pytest.fixture(scope="module")
def data(vibrating):
    term, _ = joint_descent.problem_of(
        vibrating.z, vibrating.stacks, np.ones((2, 1, *vibrating.z.shape[2:])), np.float64
    )
    term.focus(vibrating.w)
    return term


@pytest.fixture(scope="module")
def noise(vibrating, data):
    return float(np.std(data.residual(vibrating.sharp)))


def standing(seen, data, u):
    """The prior's weights that a restoration u stands with."""
    downhill = data.blur_adjoint(data.residual(u))
    return noise_and_contrast.standing_weights(*(one[:, seen.R : -seen.R, seen.R : -seen.R] for one in (u, downhill)))


def told_by(seen, data, u):
    """The moments of a restoration u."""
    R = seen.R
    left = noise_and_contrast.band_powers(data.residual(u))
    slopes = noise_and_contrast.gradient_powers(u[:, R:-R, R:-R])
    depths = np.quantile(seen.w[R:-R, R:-R], joint_descent.DECILES)
    return noise_and_contrast.moments(seen.stacks, depths, standing(seen, data, u), left, slopes)


@pytest.mark.parametrize("weight", [3e-5, 1e-3])
def test_noise_and_contrast_are_found_whatever_the_weight(vibrating, data, noise, weight):
    R = vibrating.R
    u = restore_picture(data, np.full_like(vibrating.sharp, 0.5), weight, 200)
    # low bands are set by the rim and converge last
    assert standing(vibrating, data, u)[3:] == pytest.approx(np.full(5, weight), rel=0.1)
    told = told_by(vibrating, data, u)
    truth = vibrating.sharp[:, R:-R, R:-R]
    # five depths stand for all, the frame's rim is less determined
    assert np.sqrt(told.noise) == pytest.approx(noise, rel=0.15)
    # the weight decides between what masks pass and what they do not: neither in the first band nor in the last
    inner = noise_and_contrast.gradient_powers(truth)[1:-1]
    assert 0.85 * inner.min() < told.contrast < 1.15 * inner.max()


def test_a_picture_few_iterations_on_tells_the_contrast_nevertheless(vibrating, data):
    R = vibrating.R
    u = restore_picture(data, np.full_like(vibrating.sharp, 0.5), 3e-5, 8)
    inner = noise_and_contrast.gradient_powers(vibrating.sharp[:, R:-R, R:-R])[1:-1]
    # iterations filter otherwise than the one weight that stands for them in a band; with 3e-5 itself it were 0.45
    assert 0.65 * inner.min() < told_by(vibrating, data, u).contrast < 1.15 * inner.max()


def test_powers_of_bands_are_those_of_white_noise_and_of_what_was_blurred():
    rng = np.random.default_rng(1)
    white = 0.3 * rng.standard_normal((4, 90, 110))
    # 4 images of 9900 samples in 8 bands, the least of about 400: 5 % is twice what they vary by
    assert noise_and_contrast.band_powers(white + 5.0) == pytest.approx(np.full(8, 0.09), rel=0.15)
    soft = noise_and_contrast.band_powers(gaussian_filter(white, (0, 1.5, 1.5)))
    # the filter's own square response at the middle of each ring
    at = (np.arange(8) + 0.5) / 16
    assert soft[:3] == pytest.approx(0.09 * np.exp(-((2 * np.pi * at[:3] * 1.5) ** 2)), rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("blur", [0.0, 1.5])
def test_the_weight_is_the_best_one_whatever_the_noise_s_spectrum(vibrating, data, blur):
    # soft noise is that of masks that err: most where the picture has most
    rng = np.random.default_rng(6)
    soft = gaussian_filter(rng.standard_normal(data.z.shape), (0, 0, blur, blur))
    seen = DataTerm(data.z + 0.01 * soft / soft.std(), data.blurs, data.trust)
    seen.focus(vibrating.w)
    R, truth = data.R, vibrating.sharp[:, 12 + data.R : -12 - data.R, 12 + data.R : -12 - data.R]

    def restored(weight: float):
        return restore_picture(seen, np.full_like(vibrating.sharp, 0.5), weight, 60)

    def error(weight: float) -> float:
        return float(np.sqrt(np.mean((restored(weight)[:, 12 + R : -12 - R, 12 + R : -12 - R] - truth) ** 2)))

    found = 1e-3
    for _ in range(3):
        u = restored(found)
        told = told_by(vibrating, seen, u)
        found = told.deciding / told.contrast
    least = min(error(weight) for weight in found * 2.0 ** np.array([-2, -1, 1, 2]))
    # the scene's gradient is no more alike in every band than real ones are
    assert error(found) < 1.05 * least


@pytest.mark.slow
def test_depth_takes_as_much_noise_as_solving_says(vibrating, data):
    u, weights = vibrating.sharp, PriorWeights(1e-4, 0.01)
    told = noise_and_contrast.fitted_by_depth(data, u, weights)

    def taken(factor: float) -> float:
        """Part of random photographs that picture and depth fit, per pixel of the frame."""
        noise = np.random.default_rng(5).choice([-1.0, 1.0], data.z.shape)

        def apply(x):
            out = data.change_adjoint(u, data.change(u, x))
            add_diffusion(out[:-1], x[:-1], weights.picture)
            add_diffusion(out[-1], x[-1], factor * weights.depth * weights.tilt)
            add_bending(out[-1], x[-1], factor * weights.depth * weights.bend, 1.0, 1.0)
            return out

        found = conjugate_gradients(apply, data.change_adjoint(u, noise), 150)
        return float(np.sum(noise * data.change(u, found)) / noise[0].size)

    # with the depth held by a prior a thousand times as strong only the picture fits
    assert told == pytest.approx(taken(1) - taken(1000), abs=0.1)
    assert noise_and_contrast.fitted_by_depth(data, u, replace(weights, depth=0.1)) < told


def test_a_depth_that_changes_nothing_takes_no_noise(vibrating, data):
    """At w = 0 masks are points, whatever w is: with photographs the wrong way round all of the frame ends there."""
    u = np.zeros_like(vibrating.sharp)
    assert noise_and_contrast.fitted_by_depth(data, u, PriorWeights(1e-4, 0.01)) == 0
