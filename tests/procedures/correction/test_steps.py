import numpy as np
import pytest

from procedures.correction.deconvolve import DeconvolutionTile, Splitting, deconvolve
from procedures.correction.priors import Prior
from procedures.correction.steps import differences, divergence, shrink
from procedures.correction.tiles import TileAxis
from procedures.outcome import BadParameter


@pytest.mark.parametrize("second", [False, True])
def test_the_divergence_is_the_adjoint_of_the_differences(rng, second):
    u = rng.standard_normal((3, 12, 12)).astype(np.float32)
    d = rng.standard_normal((3 if second else 2, 3, 12, 12)).astype(np.float32)
    forth, back = np.vdot(d, differences(u, second)), np.vdot(u, divergence(d, second))
    assert forth == pytest.approx(back, abs=1e-3)  # single precision


def kept(d, threshold, slopes):
    """Differences (2, 3, n, n) that are left of d."""
    d, dual = d.copy(), np.zeros_like(d)
    shrink(d, dual, np.float32(threshold), slopes)
    return d - dual


def test_colours_are_shrunk_along_the_line_that_lightness_predicts(rng):
    d = rng.standard_normal((2, 3, 4, 4)).astype(np.float32)
    slopes, threshold = rng.uniform(-2, 2, (2, 4, 4)).astype(np.float32), 0.5
    plain = d * np.maximum(1 - threshold / np.sqrt(np.sum(d**2, axis=(0, 1))), 0)
    np.testing.assert_allclose(kept(d, threshold, 0 * slopes), plain, atol=1e-6)
    found = kept(d, threshold, slopes)
    for at in np.ndindex(4, 4):
        given, (k, m) = d[..., *at].astype(float), slopes[:, *at]
        S = np.array([[1, 0, 0], [-k, 1, 0], [-m, 0, 1]])
        _, s, V = np.linalg.svd(S)
        # left = |S v| / threshold by one step of Newton's method from 0, in singular directions
        power = np.sum((given @ V.T) ** 2, axis=0)
        square, cube = np.sum(power / s**2), np.sum(power / s**4)
        left = max((np.sqrt(square) / threshold - 1) * square / cube, 0)
        wanted = np.linalg.solve(left * np.eye(3) + S.T @ S, left * given.T).T
        np.testing.assert_allclose(found[..., *at], wanted, atol=1e-5)


@pytest.mark.parametrize("name", ["total-variation", "second-order"])
def test_the_power_of_a_prior_is_that_of_its_differences(rng, name):
    prior, u = Prior(name), rng.standard_normal((1, 16, 16)).astype(np.float32)
    power = np.abs(np.fft.rfft2(u[0])) ** 2 * prior.power(16)
    counted = np.full(power.shape, 2.0)
    counted[:, [0, -1]] = 1
    # Parseval
    assert np.sum(counted * power) / 16**2 == pytest.approx(np.sum(differences(u, prior.second) ** 2), rel=1e-5)


def test_an_impossible_prior_is_refused():
    with pytest.raises(BadParameter, match="one of total-variation, second-order"):
        Prior("wishes")
    with pytest.raises(BadParameter, match="positive strength"):
        Prior(strength=0)


@pytest.mark.parametrize(("size", "n"), [(100, 128), (333, 128), (1000, 256)])
def test_the_windows_of_all_tiles_sum_to_one(size, n):
    axis, total = TileAxis(size, n, 20), np.zeros(size)
    for start in axis.starts:
        window = axis.window(start)
        assert not window[:20].any() or start + 20 <= 0 or start == axis.starts[0]
        inside = slice(max(0, -start), min(n, size - start))
        total[start + inside.start : start + inside.stop] += window[inside]
    np.testing.assert_allclose(total, 1, atol=1e-6)


def tile_of(u, weight):
    """The samples of an unblurred tile."""
    n = u.shape[-1]
    return DeconvolutionTile(
        u.astype(np.float32), weight.astype(np.float32), np.ones((1, n, n // 2 + 1), np.complex64), [0]
    )


def test_clipped_light_is_at_least_the_clipping_level():
    x = np.arange(32) - 15.5
    light = 0.2 + 1.2 * np.exp(-(x**2 + x[:, None] ** 2) / 60)
    samples = np.minimum(light, 1.0)[None]
    weight = np.where(samples >= 1, -1.0, 1.0)
    restored = deconvolve(
        tile_of(samples, weight), samples.astype(np.float32), Prior(), 1e-4, 0.05, Splitting(60, 0.3, 1.0)
    )
    assert restored[weight < 0].min() > 0.99
    np.testing.assert_allclose(restored[weight > 0], light[None][weight > 0], atol=0.01)


def test_without_noise_and_with_all_samples_the_blur_is_removed(rng):
    n = 48
    u = np.kron(rng.uniform(0.2, 0.8, (6, 6)), np.ones((8, 8)))[None]
    f = np.fft.fftfreq(n)
    H = np.exp(-2 * np.pi**2 * 0.7**2 * (f[:, None] ** 2 + f[: n // 2 + 1] ** 2))[None]
    samples = np.fft.irfft2(H * np.fft.rfft2(u), (n, n)).astype(np.float32)
    tile = DeconvolutionTile(samples, np.ones_like(samples), H.astype(np.complex64), [0])
    restored = deconvolve(tile, samples, Prior(), 1e-6, 0.05, Splitting(300, 1.0, 1.0))
    assert np.std(restored - u) < 0.1 * np.std(samples - u)
