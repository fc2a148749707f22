"""Noise and contrast told from a restoration, against the truth and against solving for random photographs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from procedures.restoration.joint import joint_descent, noise_and_contrast
from procedures.restoration.joint.data_term import conjugate_gradients, restore_picture
from procedures.restoration.joint.gauss_newton import PriorWeights
from procedures.restoration.joint.priors import roughness
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


@pytest.mark.parametrize("weight", [3e-5, 1e-3])
def test_noise_and_contrast_are_found_whatever_the_weight(vibrating, data, noise, weight):
    R = vibrating.R
    u = restore_picture(data, np.full_like(vibrating.sharp, 0.5), weight, 200)
    inside = u[:, R:-R, R:-R]
    variance, contrast = noise_and_contrast.moments(
        vibrating.stacks, 3.0, weight, float(np.mean(data.residual(u) ** 2)), 2 * roughness(inside) / inside.size
    )
    truth = vibrating.sharp[:, R:-R, R:-R]
    # one depth stands for all, the frame's rim is less determined
    assert np.sqrt(variance) == pytest.approx(noise, rel=0.15)
    assert contrast == pytest.approx(2 * roughness(truth) / truth.size, rel=0.15)


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
