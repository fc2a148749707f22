from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from procedures import Psf, Refused
from procedures.field.focus import FREQUENCY, FocusSurface, best_focus, focus_surface, sharpest
from procedures.field.maps import radius_direction
from procedures.field.surfaces import fit_surface
from procedures.psf_field import Node, in_half_diagonals

from .lens import LENS, NEAR, SHAPE, FieldCamera, K, S, grid, nodes

SLOW_FIXTURES = {"bracket"}

POSITIONS = np.linspace(-0.24, 0.24, 5)  # micrometres of defocus
TILTED = FieldCamera(replace(LENS, tilt_um=(0.06, -0.04)), period_px=NEAR)


def drawn_bracket(covariance, seed):
    rng = np.random.default_rng(seed)
    return {float(z): nodes(TILTED, grid(), covariance, rng, defocus_um=float(z)) for z in POSITIONS}


@pytest.fixture(scope="module")
def bracket(covariance):
    return drawn_bracket(covariance, 11)


@lru_cache
def true_focus(x, y, angle):
    """True focus of the greatest MTF; the photosites' factor is the same at every focus."""
    z = np.linspace(-0.27, 0.27, 13)
    mtf = TILTED.lens_mtf(x, y, FREQUENCY, angle, z)
    i = int(np.argmax(mtf))
    a, b, _ = np.polyfit(z[i - 2 : i + 3], mtf[i - 2 : i + 3], 2)
    return -b / (2 * a)


@pytest.mark.slow
def test_best_focus_is_within_its_band_over_the_field(covariance):
    # a quadratic surface has six parameters, so the errors of a map are correlated: three draws
    inside = []
    for seed in range(3):
        maps = {one.name: one for one in focus_surface(drawn_bracket(covariance, seed), SHAPE).maps(5)}
        sagittal, meridional = maps["focus_sagittal"], maps["focus_meridional"]
        for j, k in np.argwhere(np.isfinite(sagittal.value)):
            x, y = float(sagittal.x[k]), float(sagittal.y[j])
            radius = radius_direction(SHAPE, x, y)
            for one, angle in ((sagittal, radius + np.pi / 2), (meridional, radius)):
                inside.append(abs(one.value[j, k] - true_focus(x, y, angle)) < 1.96 * one.uncertainty[j, k])
    assert np.mean(inside) >= 0.9


def test_tilt_and_curvature_are_those_of_the_lens(bracket):
    surface = focus_surface(bracket, SHAPE, unit="um")
    # W = tilt . q + curvature |q - a|^2, compensated by the added defocus; 4 sigma, and 3 % because coma and
    # astigmatism perturb the quadratic
    numbers = surface.numbers()
    lens = TILTED.lens
    for i, name in enumerate(("focus_tilt_x", "focus_tilt_y")):
        expected = -(lens.tilt_um[i] - 2 * lens.field_curvature_um * lens.axis[i])
        assert numbers[name].value == pytest.approx(expected, abs=4 * numbers[name].uncertainty + 0.003)
    bend = numbers["field_curvature"]
    assert bend.value == pytest.approx(-lens.field_curvature_um, abs=4 * bend.uncertainty + 0.003)
    assert bend.uncertainty < 0.01


def test_the_sharpest_position_is_the_middle_one_and_two_are_refused(bracket):
    assert sharpest(bracket) == pytest.approx(0.0)
    two = {z: bracket[z] for z in list(bracket)[:2]}
    with pytest.raises(Refused, match="3 focus positions or more; there are 2"):
        focus_surface(two, SHAPE)


@pytest.mark.slow
def test_a_bracket_on_one_side_of_the_focus_is_refused(covariance):
    rng = np.random.default_rng(1)
    beyond = {z: nodes(TILTED, grid(3, 3), covariance, rng, defocus_um=z) for z in (0.3, 0.36, 0.42)}
    with pytest.raises(Refused, match="extend the bracket"):
        focus_surface(beyond, SHAPE)


def test_uncertainties_are_those_that_the_errors_of_single_places_add_up_to(rng):
    # the quadratic surface is exact, so the only errors are the independent ones of the measured focus; each number is
    # linear in it, so a finite difference is a derivative
    places, variance = grid(4, 3), rng.uniform(1e-6, 4e-6, (12, 2))
    x, y = in_half_diagonals(places, SHAPE).T
    best = np.column_stack([0.1 * x + x * y - 0.2 * y**2, 0.3 - 0.2 * y + 0.1 * x**2])
    covariances = np.einsum("nm,ma->nma", variance, np.eye(2))

    def numbers(values):
        surface = fit_surface(in_half_diagonals(places, SHAPE), values, covariances, (2,))
        return FocusSurface(SHAPE, places, values, surface, "mm").numbers()

    base, spread = numbers(best), dict.fromkeys(numbers(best), 0.0)
    for index in np.ndindex(best.shape):
        moved = best.copy()
        moved[index] += 1e-4
        for name, quantity in numbers(moved).items():
            spread[name] += ((quantity.value - base[name].value) / 1e-4) ** 2 * variance[index]
    for name, quantity in base.items():
        assert quantity.uncertainty == pytest.approx(spread[name] ** 0.5, rel=1e-6), name


def test_the_focus_of_a_place_scatters_as_its_variance_says(rng):
    # Gaussians whose width grows with the defocus. 9 places, 2 directions, 20 draws: the mean of their squared
    # errors has a standard deviation of sqrt(2 / 360) = 7.5 %
    x, noise = (np.arange(K) - K // 2) / S, 2e-4
    singles, means = [], []
    for _ in range(20):
        bracket: dict = {}
        for z in np.linspace(-1.0, 1.0, 5):
            wide = np.exp(-(x**2) / 2 / (0.45**2 + 0.1 * (z - 0.1) ** 2))
            support = np.outer(wide, wide) / wide.sum() ** 2
            bracket[float(z)] = [
                Node(at, np.zeros((2, 2)), at, Psf(support + noise * rng.standard_normal((K, K)), S,
                     noise**2 * np.eye(K * K)), f"{z}", number)
                for number, at in enumerate(grid(3, 3))
            ]  # fmt: skip
        places = best_focus(bracket, SHAPE)
        errors = np.array([[optimum.at - 0.1 for optimum in place.optima] for place in places])
        covariances = np.array([place.covariance for place in places])
        singles += (errors**2 / np.diagonal(covariances, axis1=1, axis2=2)).ravel().tolist()
        means += (errors.mean(axis=1) ** 2 / covariances.mean(axis=(1, 2))).tolist()
        assert sum(places[0].optima[0].sensitivities.values()) == pytest.approx(1)
    assert np.mean(singles) == pytest.approx(1, abs=0.3)
    assert np.mean(means) == pytest.approx(1, abs=0.4)
