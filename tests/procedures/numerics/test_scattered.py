import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procedures.numerics.scattered import Hull, Polynomial, ThinPlate, hull_area, monomials

PLACES = np.random.default_rng(4).uniform(-1, 1, (25, 2))
TRUST = np.random.default_rng(5).uniform(0.3, 3, 25)
POINTS = np.random.default_rng(6).uniform(-1, 1, (9, 2))


@pytest.mark.parametrize("degree", range(4))
def test_a_polynomial_of_its_degree_is_reproduced(degree):
    c = np.random.default_rng(degree).standard_normal((degree + 1) * (degree + 2) // 2)
    smoother = Polynomial(PLACES, TRUST, degree)
    predicted = smoother.weights(POINTS) @ (monomials(PLACES, degree) @ c)
    np.testing.assert_allclose(predicted, monomials(POINTS, degree) @ c, atol=1e-10)


def test_weights_and_stiffness_of_a_plate_act_as_they_should():
    trust = np.ones(25)
    trust[7] = 1e8
    w = Polynomial(PLACES, trust, 2).weights(PLACES[7:8])[0]
    assert w[7] == pytest.approx(1, abs=1e-5)
    plate = ThinPlate(PLACES, TRUST)
    np.testing.assert_allclose(plate.weights(PLACES), np.eye(25), atol=1e-9)
    plane = PLACES @ [2.0, -1.0] + 3
    np.testing.assert_allclose(plate.weights(POINTS) @ plane, POINTS @ [2.0, -1.0] + 3, atol=1e-9)
    stiff = ThinPlate(PLACES, TRUST, 1e7).weights(POINTS)
    np.testing.assert_allclose(stiff, Polynomial(PLACES, TRUST, 1).weights(POINTS), atol=1e-5)


@pytest.mark.parametrize("smoother", [Polynomial(PLACES, TRUST, 3), ThinPlate(PLACES, TRUST, 0.1)])
def test_weights_add_to_1(smoother):
    np.testing.assert_allclose(smoother.weights(POINTS).sum(axis=1), 1, atol=1e-9)


@pytest.mark.parametrize("places", [PLACES[:5], PLACES[:9, :1] * [1.0, 2.0]], ids=["too few", "on a line"])
def test_places_that_determine_no_polynomial_are_refused(places):
    with pytest.raises(ValueError, match=f"{len(places)} places do not determine a polynomial of degree 2"):
        Polynomial(places, TRUST[: len(places)], 2)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_the_nearest_point_of_a_hull_is_in_it_and_no_other_is_nearer(seed):
    rng = np.random.default_rng(seed)
    hull = Hull(rng.uniform(-1, 1, (8, 2)))
    point = rng.uniform(-3, 3, (1, 2))
    near = hull.nearest(point)
    assert hull.holds(near)[0]
    mixtures = rng.dirichlet(np.full(8, 0.2), 200) @ hull.places
    assert np.linalg.norm(mixtures - point, axis=1).min() >= np.linalg.norm(near - point) - 1e-9


def test_a_hull_has_the_area_of_its_corners_and_a_line_has_none():
    with pytest.raises(ValueError, match="not lie on one line"):
        Hull(np.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)]))
    square = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (0.0, 2.0), (1.0, 1.0)])
    assert hull_area(square) == pytest.approx(6)
    assert hull_area(square[:2]) == hull_area(np.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])) == 0
