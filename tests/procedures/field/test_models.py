from __future__ import annotations

import numpy as np
import pytest

from procedures.field.models import RINGS, AxialSymmetry, Optic

K = 9


@pytest.fixture
def optic():
    # every sample its own component: nothing is left out
    return Optic(np.eye(K * K), np.eye(K * K), np.eye(K * K), K)


def test_psfs_turn_with_the_direction_to_the_axis(optic, rng):
    # equation (4.20): a quarter turn of the place about the axis is a quarter turn of the PSF
    model = AxialSymmetry(rng.uniform(-1, 1, (40, 2)), np.ones(40), optic, 3, (0.1, -0.2))
    unknowns = rng.standard_normal(model.design(np.zeros((1, 2))).shape[2])
    unknowns[: K * K] = 0  # the sensor's part does not turn
    place = np.array([0.4, 0.3])
    turned = np.array(model.axis) + [[0, -1], [1, 0]] @ (place - model.axis)
    here, there = (model.design(p[None])[0] @ unknowns for p in (place, turned))
    # x towards y on the sensor, rows down: numpy's rot90 turns the other way
    np.testing.assert_allclose(there.reshape(K, K), np.rot90(here.reshape(K, K), -1), atol=1e-12)


def test_psfs_are_symmetric_about_the_line_to_the_axis(optic, rng):
    model = AxialSymmetry(rng.uniform(-1, 1, (40, 2)), np.ones(40), optic, 4, (0.1, -0.2))
    unknowns = rng.standard_normal(model.design(np.zeros((1, 2))).shape[2])
    unknowns[: K * K] = 0
    h = (model.design(np.array([[0.8, -0.2]]))[0] @ unknowns).reshape(K, K)
    np.testing.assert_allclose(h, h[::-1], atol=1e-12)


def test_what_the_model_can_say_is_reproduced(optic, rng):
    places = rng.uniform(-1, 1, (60, 2))
    model = AxialSymmetry(places, rng.uniform(0.5, 2, 60), optic, 2, (0.0, 0.1))
    unknowns = rng.standard_normal(K * K + 3 * RINGS)
    values = model.design(places) @ unknowns
    elsewhere = rng.uniform(-0.7, 0.7, (5, 2))
    expected = model.design(elsewhere) @ unknowns
    np.testing.assert_allclose(model.predict(elsewhere, values), expected, atol=1e-4)
    weights = model.transfer(elsewhere, K * K)
    np.testing.assert_allclose(np.einsum("narb,rb->na", weights, values), expected, atol=1e-4)
