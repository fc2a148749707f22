import numpy as np
import pytest

from procedures.outcome import BadParameter
from procedures.restoration.joint import priors
from procedures.restoration.joint.schedule import Schedule, Scheme, Statistics
from procedures.restoration.masks.array_loops import add_bending


def test_priors_agree_with_their_gradients_and_keep_what_they_should(rng):
    x, d = rng.standard_normal((2, 2, 9, 11))
    down, across = rng.random((8, 11)), rng.random((9, 10))
    t = 1e-6
    slope = (priors.roughness(x + t * d, down, across) - priors.roughness(x - t * d, down, across)) / (2 * t)
    assert slope == pytest.approx(np.vdot(d, priors.diffuse(x, down, across)), rel=1e-6)  # central difference
    x, d = rng.standard_normal((2, 9, 11))
    t, out = 1e-6, np.zeros(x.shape)
    add_bending(out, x, 1.0, down, across)
    slope = (priors.bending(x + t * d, down, across) - priors.bending(x - t * d, down, across)) / (2 * t)
    assert slope == pytest.approx(np.vdot(d, out), rel=1e-6)  # central difference
    y, z = np.indices(x.shape)
    assert priors.bending(0.3 * y - 0.2 * z + 1, down, across) == pytest.approx(0, abs=1e-12)
    assert priors.diffuse(rng.standard_normal((1, 7, 7))).sum() == pytest.approx(0, abs=1e-12)
    assert not priors.diffuse(np.full((1, 7, 7), 3.0)).any()
    # a step of height 2 across 10 rows: total variation 20, half the weighted square is half of that
    u = np.zeros((1, 10, 12))
    u[..., 6:] = 2
    assert priors.roughness(u, *priors.total_variation(u, 1e-3)) == pytest.approx(10)
    u = np.zeros((3, 6, 6))
    u[:, :, 3:] = np.array([3.0, 4.0, 0.0])[:, None, None]
    _, across = priors.total_variation(u, 1e-3)
    assert across[2, 2] == pytest.approx(1 / 5)


def test_depth_edges_are_not_penalised_and_slopes_are():
    w = np.concatenate([np.zeros((6, 4)), np.full((6, 4), 1.0)], axis=1) + 0.02 * np.arange(8)
    _, across = priors.steps_allowed(w, 0.25)
    assert across[0, 3] < 0.005
    assert across[0, 1] > 0.999


@pytest.mark.parametrize(
    ("text", "scheme"),
    [
        ("20x(8+10)+5x20", Scheme(20, 8, 10, 5, 20)),
        ("50 × (8 + 10) + 100", Scheme(50, 8, 10, 1, 100)),
        ("3x(8+0)", Scheme(3, 8, 0, 1, 0)),
    ],
)
def test_schemes_are_written_as_in_the_thesis(text, scheme):
    assert Scheme.parse(text) == scheme


@pytest.mark.parametrize("text", ["", "20", "20x8", "0x(8+10)", "2x(0+0)"])
def test_other_schemes_are_refused(text):
    with pytest.raises(BadParameter):
        Scheme.parse(text)


def test_weights_end_at_those_required_by_noise_and_by_the_typical_slope():
    schedule, quiet = Schedule(20), Statistics(1e-4, 1e-4, 0.02)
    weights = [schedule.at(n, quiet) for n in range(20)]
    pictures = [w.picture for w in weights]
    assert pictures == sorted(pictures, reverse=True)
    assert weights[-1].picture == pytest.approx(max(1e-7, schedule.final(quiet).picture))
    noisy = Statistics(0.01, 0.01, 0.02)
    assert schedule.at(19, noisy).picture == schedule.final(noisy).picture
    last = Schedule(20, picture=2e-3, depth=0.5).at(19, Statistics(1e-4, 1e-4, 0.02))
    assert (last.picture, last.depth) == (2e-3, 0.5)
    x = np.mgrid[0:20, 0:30][1]
    gentle, steep = (priors.depth_variation(slope * x, 0.014)[1] for slope in (0.01, 0.14))
    np.testing.assert_allclose(gentle, 1)
    # |d|^2 / |d|: ten times the slope has a tenth of the weight
    np.testing.assert_allclose(steep[1:-1], 0.1)
