import numpy as np
import pytest

from procedures.field.models import AxialSymmetry, Optic

K = 9


@pytest.fixture
def optic():
    # every sample its own component
    return Optic(np.eye(K * K), np.eye(K * K), np.eye(K * K), K)


def test_psfs_turn_with_the_axis_are_symmetric_about_it_and_keep_the_models_values(optic, rng):
    # equation (4.20): a quarter turn of the place about the axis is a quarter turn of the PSF
    model = AxialSymmetry(rng.uniform(-1, 1, (40, 2)), np.ones(40), optic, 3, (0.1, -0.2))
    unknowns = rng.standard_normal(model.design(np.zeros((1, 2))).shape[2])
    unknowns[: K * K] = 0  # the sensor's part does not turn
    place = np.array([0.4, 0.3])
    turned = np.array(model.axis) + [[0, -1], [1, 0]] @ (place - model.axis)
    here, there = (model.design(p[None])[0] @ unknowns for p in (place, turned))
    # x towards y on the sensor, rows down: numpy's rot90 turns the other way
    np.testing.assert_allclose(there.reshape(K, K), np.rot90(here.reshape(K, K), -1), atol=1e-12)
    model = AxialSymmetry(rng.uniform(-1, 1, (40, 2)), np.ones(40), optic, 4, (0.1, -0.2))
    unknowns = rng.standard_normal(model.design(np.zeros((1, 2))).shape[2])
    unknowns[: K * K] = 0
    h = (model.design(np.array([[0.8, -0.2]]))[0] @ unknowns).reshape(K, K)
    np.testing.assert_allclose(h, h[::-1], atol=1e-12)
    places = rng.uniform(-1, 1, (60, 2))
    model = AxialSymmetry(places, rng.uniform(0.5, 2, 60), optic, 2, (0.0, 0.1))
    unknowns = rng.standard_normal(model.design(places[:1]).shape[2])
    values = model.design(places) @ unknowns
    elsewhere = rng.uniform(-0.7, 0.7, (5, 2))
    expected = model.design(elsewhere) @ unknowns
    np.testing.assert_allclose(model.predict(elsewhere, values), expected, atol=1e-4)
    weights = model.transfer(elsewhere, K * K)
    np.testing.assert_allclose(np.einsum("narb,rb->na", weights, values), expected, atol=1e-4)


def test_the_symmetric_lens_is_extrapolated_to_the_radius_of_its_fourth_node(optic):
    axis, circle = (0.1, 0.0), np.linspace(0, 2 * np.pi, 5)[:-1]
    ring = np.array(axis) + 0.6 * np.column_stack([np.cos(circle), np.sin(circle)])
    model = AxialSymmetry(np.vstack([ring, [[0.1, 0.0]]]), np.ones(5), optic, 2, axis)
    held = np.array([[0.4, 0.3], [0.7, 0.0], [0.3, 0.1]])
    points = np.array([[0.5, 0.4], [0.9, 0.0], [0.3, 0.1]])  # within the circle, beyond it, not beyond the nodes
    expected = [points[0], held[1], points[2]]
    np.testing.assert_allclose(model.carried(held, points), expected, atol=1e-9)
    beyond = model.carried(held[:1], held[:1] + 3.0)[0]
    assert np.hypot(*(beyond - axis)) == pytest.approx(0.6)
