"""The PSF between the nodes, compared with a lens with coma, astigmatism, field curvature and decentring."""

from dataclasses import replace

import numpy as np
import pytest

from procedures import Psf, Refused
from procedures.field.interpolate import _rank, interpolate, rebuild
from procedures.field.models import Separate
from procedures.numerics.scattered import ThinPlate
from procedures.psf_field import prior_covariance_part

from .conftest import SEED
from .lens import NEAR, SHAPE, FieldCamera, K, S, grid, nodes

SLOW_FIXTURES = {"measured"}


@pytest.fixture(scope="module")
def places():
    return np.random.default_rng(7).uniform([95, 65], [655, 435], (30, 2))


def norms(psfs, camera, places):
    """Norms of the errors of supports at their places."""
    return [np.linalg.norm(psf.h - camera.psf(*place)) for psf, place in zip(psfs, places, strict=True)]


def on_grid(camera, covariance, seed):
    return nodes(camera, grid(), covariance, np.random.default_rng(seed))


def test_the_psf_between_the_nodes_is_as_good_as_at_them(camera, measured, interpolated, places):
    # the bound is 1.5; smoothing over 25 nodes leaves less than the error of one
    at_nodes = norms([node.psf for node in measured], camera, grid())
    between = norms([interpolated.field.at(*p) for p in places], camera, places)
    assert np.mean(between) < np.mean(at_nodes)
    assert np.max(between) < 1.5 * np.mean(at_nodes)


@pytest.mark.slow
def test_nine_charts_determine_the_lens_between_them(camera, covariance):
    # their PSFs alone do not span it: the cross-validation error is then 6.5 standard deviations, the error between
    # them 1.4 times that at a node; the bound of the latter is 1.5 for 25 nodes
    at = np.array([(x, y) for y in (60.0, 250.0, 440.0) for x in (70.0, 375.0, 680.0)])
    nine = nodes(camera, at, covariance, np.random.default_rng(1))
    interpolated = interpolate("G1", SHAPE, nine)
    assert interpolated.recipe.kind == "symmetric lens"
    assert interpolated.candidates[0].error < 3**2
    halfway = ((222, 62), (528, 62), (72, 155))
    between = norms([interpolated.field.at(*p) for p in halfway], camera, halfway)
    assert np.max(between) < 1.2 * np.mean(norms([node.psf for node in nine], camera, at))


def test_the_predicted_error_is_the_actual_one(camera, interpolated, places):
    noise, lack = interpolated.field.error(places)
    true = [Psf.of(camera.parameters(*p), np.zeros_like(interpolated.field.lack_rest), K, S) for p in places]
    actual = [
        np.linalg.norm(interpolated.field.at(*p).extended() - one.extended())
        for p, one in zip(places, true, strict=True)
    ]
    # cross-validation predicts over larger distances: up to twice too much
    assert 0.45 < np.mean(actual) / np.mean(np.hypot(noise, lack)) < 1.1


def test_the_noise_of_a_place_is_that_of_repeated_measurements(camera, covariance, interpolated):
    # with the model kept, 40 draws give a variance to sqrt(2 / 40) = 22 % (one sigma); the trace averages many
    # directions, so that 10 % is beyond three
    rng = np.random.default_rng(3)
    base = [n.psf.parameters for n in nodes(camera, grid(), 0 * covariance, rng, centre_px=0.0)]
    drawn = []
    held = [prior_covariance_part(node.psf) for node in interpolated.field.nodes]
    roots = [root_of(covariance - one) for one in held]
    for _ in range(40):
        noisy = []
        for node, p, root in zip(interpolated.field.nodes, base, roots, strict=True):
            noisy.append(replace(node, psf=Psf.of(p + root @ rng.standard_normal(len(root)), covariance, K, S)))
        field = replace(interpolated.field, nodes=tuple(noisy))
        drawn.append(field.parameters(np.array([[200.0, 330.0]]))[0])
    of_priors = np.tensordot(interpolated.field.share, held, axes=1)
    spread, expected = np.var(drawn, axis=0, ddof=1), np.diag(interpolated.field.noise(200.0, 330.0) - of_priors)
    assert spread[: K * K].sum() == pytest.approx(expected[: K * K].sum(), rel=0.1)
    # each amplitude is one number; all six together to two of 22 %
    np.testing.assert_allclose(np.mean(spread[K * K :] / expected[K * K :]), 1, rtol=0.44)


def root_of(covariance):
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0))


def test_every_psf_has_sum_1_and_the_tails_priors_do_not_average_out(interpolated, places):
    # cos 4 and sin 4 are known by their priors alone: a share of 0.3 of the mean tail, at every node the same
    base = interpolated.field.nodes[0].psf
    of_shapes = (0.3 * base.tail.amplitudes[0]) ** 2
    C = np.zeros_like(interpolated.field.lack_rest)
    C[-2:, -2:] = of_shapes * np.eye(2)
    C[0, 0] = 1e-6
    psfs = [Psf.of(base.parameters, C, K, S)] * len(interpolated.field.nodes)
    nodes_ = tuple(replace(node, psf=psf) for node, psf in zip(interpolated.field.nodes, psfs, strict=True))
    noise = replace(interpolated.field, nodes=nodes_).noise(375.0, 250.0)
    # the other parameter's noise contributes parts in a thousand through the components
    np.testing.assert_allclose(np.diag(noise)[-2:], of_shapes, rtol=0.01)
    assert noise[0, 0] < 0.5 * 1e-6
    # the noise drawn for the nodes adds to 1e-7
    np.testing.assert_allclose(interpolated.field.samples(places).sum(axis=(1, 2)), 1, atol=1e-6)


@pytest.mark.slow
def test_the_axis_of_a_decentred_lens_is_within_its_uncertainty(camera, covariance):
    off = []
    for seed in range(3):
        axis = interpolate("G1", SHAPE, on_grid(camera, covariance, seed)).axis
        off.append((axis.position - camera.lens.axis) / np.sqrt(np.diag(axis.covariance)))
        assert np.sqrt(np.diag(axis.covariance)).max() < 0.02
    assert np.abs(off).max() < 3.5


def test_a_symmetric_lens_is_recognised_and_so_is_one_that_is_not(camera, covariance, interpolated):
    assert interpolated.recipe.kind == "symmetric lens"
    # flares across the radius instead of along it: no symmetric lens has them
    y = np.linspace(-1, 1, 17)
    centre = camera.psf(374.5, 249.5)
    flare = centre * np.outer(y - y**3 / 2, np.ones(17))
    swirled = []
    for node, place in zip(on_grid(camera, covariance, 1), grid(), strict=True):
        noise = node.psf.h - camera.psf(*place)
        u, v = camera.field(*place)
        h = centre + 0.3 * (u * flare - v * flare.T) + noise
        swirled.append(replace(node, psf=replace(node.psf, h=h)))
    assert interpolate("G1", SHAPE, swirled).recipe.kind != "symmetric lens"


@pytest.mark.slow
def test_a_uniform_field_is_constant(covariance):
    lens = replace(FieldCamera().lens, coma_um=0.0, astigmatism_um=0.0, field_curvature_um=0.0)
    flat = FieldCamera(lens, period_px=NEAR)
    field = interpolate("G1", SHAPE, on_grid(flat, covariance, SEED)).field
    errors = [np.linalg.norm(field.at(x, y).h - flat.psf(300, 200)) for x, y in grid(3, 3, 0.2)]
    # the mean of 25 nodes: a fifth of the error of one, and what the choice of a model adds
    assert np.mean(errors) < 0.45 * np.sqrt(np.trace(covariance[: K * K, : K * K]))


def test_beyond_the_nodes_a_surface_is_constant_and_a_symmetric_lens_extrapolated_to_their_radius(camera, interpolated):
    side = np.array([375.0, 2.0])
    assert not interpolated.field.inside(side[None])[0]
    near = interpolated.field.hull.nearest(side[None])[0]
    error, of_nearest = (np.linalg.norm(interpolated.field.at(*place).h - camera.psf(*side)) for place in (side, near))
    assert error < 0.7 * of_nearest
    # the corner lies farther from the axis than any node: as on the way there
    beyond = interpolated.field.samples(np.array([[-400.0, -300.0], [-800.0, -600.0]]))
    np.testing.assert_allclose(*beyond, atol=1e-3)
    field = replace(
        interpolated.field, model=Separate("plate", ThinPlate(interpolated.field.model.places, np.ones(25)))
    )
    near = field.hull.nearest(np.array([[2.0, 250.0]]))[0]
    assert near[0] == pytest.approx(grid()[0, 0], abs=0.1)
    np.testing.assert_allclose(field.at(2.0, 250.0).h, field.at(*near).h, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("chosen", "words"), [(slice(5), "from 6 places"), (slice(0, None, 5), "one line")])
def test_too_few_nodes_and_nodes_on_a_line_are_refused(camera, covariance, chosen, words):
    few = nodes(camera, grid(5, 7)[chosen], covariance, np.random.default_rng(1))
    with pytest.raises(Refused, match=words):
        interpolate("G1", SHAPE, few)


def test_a_recipe_builds_the_same_field_again(interpolated, places):
    again = rebuild("G1", SHAPE, interpolated.field.nodes, interpolated.recipe, len(interpolated.field.components))
    np.testing.assert_allclose(again.samples(places), interpolated.field.samples(places), atol=1e-12)
    np.testing.assert_allclose(again.at(300, 200).covariance, interpolated.field.at(300, 200).covariance, atol=1e-14)


def test_repeated_measurements_are_excluded_together(camera, covariance, interpolated):
    # otherwise each is predicted by its repetition, and a model that interpolates the nodes wins
    rng = np.random.default_rng(2)
    twice = nodes(camera, grid(), covariance, rng) + nodes(camera, grid(), covariance, rng)
    again = interpolate("G1", SHAPE, twice)
    assert again.recipe.kind == interpolated.recipe.kind
    noise = [np.trace(one.field.noise(300, 200)[: K * K, : K * K]) for one in (again, interpolated)]
    assert noise[0] < 0.7 * noise[1]
    with pytest.raises(Refused, match="plane G1 has 3"):
        interpolate("G1", SHAPE, twice[:3] + twice[25:28])


def test_of_equal_errors_within_rounding_the_fewest_components_rank_first():
    scores = [("constant", 4, 1.1517628096640071), ("constant", 1, 1.1517628096640073), ("linear", 1, 1.1517)]
    assert sorted(scores, key=_rank) == [scores[2], scores[1], scores[0]]
