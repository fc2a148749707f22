from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from procedures.outcome import BadInput, BadParameter
from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.filter import PAPER, FilterParameters, Samples, fuse_scale
from procedures.ray_histogram.multiscale import samples_of

BOTH = pytest.mark.parametrize("parameters", [PAPER, FilterParameters()], ids=["paper", "defaults"])


def equal_histograms(picture: npt.NDArray[np.float32]) -> Samples:
    rows, columns = picture.shape[:2]
    one = np.zeros(60, np.float32)
    one[[3, 25, 47]] = 100.0
    return Samples(picture, np.tile(one, (rows, columns, 1)), np.full((rows, columns), 100, np.float32))


def naive_fusion(frame: Samples, kappa: float, b: int) -> npt.NDArray[np.float64]:
    """Algorithm 1 as printed, pixel by pixel, for patches 3 x 3 in the interior."""
    u, h, n = (np.asarray(a, np.float64) for a in (frame.picture, frame.histogram, frame.count))
    rows, columns = n.shape
    out, covered = np.zeros_like(u), np.zeros((rows, columns, 1))
    patch = lambda a, r, c: a[r - 1 : r + 2, c - 1 : c + 2]  # noqa: E731
    interior = [(r, c) for r in range(1, rows - 1) for c in range(1, columns - 1)]
    for r, c in interior:
        similar = []
        for q, s in interior:
            if max(abs(q - r), abs(s - c)) > b:
                continue
            x, y = patch(h, r, c), patch(h, q, s)
            ratio = np.sqrt(patch(n, q, s) / patch(n, r, c))[..., None]
            keep = x + y > 1
            d = ((ratio * x - y / ratio)[keep] ** 2 / (x + y)[keep]).sum()
            if d < kappa * keep.sum() or (q, s) == (r, c):
                similar.append(patch(u * n[..., None], q, s) / patch(n, q, s)[1, 1])
        patch(out, r, c)[:] += np.mean(similar, 0)
        patch(covered, r, c)[:] += 1
    return out / covered


@BOTH
def test_a_constant_picture_is_unchanged(flat_film, parameters):
    frame = replace(samples_of(flat_film), picture=np.full((24, 21, 3), 0.7, np.float32))
    np.testing.assert_allclose(fuse_scale(frame, parameters).picture, 0.7, rtol=2e-5)  # float32 sums of 169 weights


@BOTH
def test_equal_histograms_give_the_plain_mean_of_the_block(rng, parameters):
    picture = rng.random((31, 30, 3)).astype(np.float32)
    fused = fuse_scale(equal_histograms(picture), parameters)
    mean = picture[15 - 6 : 15 + 7, 14 - 6 : 14 + 7].mean((0, 1))
    np.testing.assert_allclose(fused.picture[15, 14], mean, rtol=1e-5)
    assert fused.similar[15, 14] == 169


def test_result_agrees_with_the_algorithm_as_printed(light, rng):
    levels = 0.2 + 0.8 * (np.add.outer(np.arange(12), np.arange(11)) > 11)
    film = film_of_samples(light(levels, 24))
    film.count[:] = rng.integers(20, 30, film.count.shape)
    frame = samples_of(film)
    fused = fuse_scale(frame, replace(PAPER, search=2, at_least=0)).picture
    # away from the rim, where the paper leaves the patches' shape open; only equal counts make patch means plain
    even = replace(frame, count=np.full_like(frame.count, 24))
    found_even = fuse_scale(even, replace(PAPER, search=2, at_least=0)).picture
    np.testing.assert_allclose(found_even[4:-4, 4:-4], naive_fusion(even, 1.0, 2)[4:-4, 4:-4], rtol=1e-4)
    assert np.isfinite(fused).all()


def test_threshold_is_eased_only_where_few_are_similar(light):
    y, x = np.mgrid[:24, :24] - 11.5
    frame = samples_of(film_of_samples(light(0.2 + np.exp(-(x**2 + y**2) / 18), 400)))
    strict, eased = (fuse_scale(frame, replace(FilterParameters(), ease=ease)).similar for ease in (0.0, 0.005))
    # chi-square per bin of such different patches varies by a factor: three quarters above the threshold reach more
    few = strict < 10
    assert (eased[few] > strict[few] + 1).mean() > 0.5
    # half weights count in part: 15 candidates under the threshold weigh 15 at most
    np.testing.assert_array_equal(eased[strict > 16], strict[strict > 16])


def test_easing_does_not_blur_edges(light):
    edge = np.where(np.arange(30) < 15, 0.2, 0.6)[None, :].repeat(24, 0)
    frame = samples_of(film_of_samples(light(edge, 400)))
    strict, eased = (fuse_scale(frame, replace(FilterParameters(), ease=ease)).picture for ease in (0.0, 0.005))
    # the other side is hundreds of thresholds away; slightly more noise is averaged
    assert np.std(eased - edge[..., None]) < 1.02 * np.std(strict - edge[..., None])


def test_pixels_of_different_nature_are_never_averaged(light):
    levels = np.where(np.arange(30) < 15, 0.05, 2.0)[None, :].repeat(24, 0)
    film = film_of_samples(light(levels, 128))
    picture = fuse_scale(samples_of(film), replace(PAPER, at_least=0)).picture
    # a dark pixel that shared one bright patch in ten would triple; its own noise after fusion is a few per cent
    assert picture[:, :13].max() < 0.075
    assert picture[:, 17:].min() > 1.4


def test_noise_falls_with_the_samples_averaged(light):
    film = film_of_samples(light(np.full((40, 40), 0.4), 64))
    fused = fuse_scale(samples_of(film), FilterParameters(kappa=3.0))
    inner = (slice(8, -8), slice(8, -8))
    before, after = film.mean[inner].std(), fused.picture[inner].std()
    # 169 pixels, and the aggregation's reach: 13 times less noise or more; 10 allows for its few degrees of freedom
    assert after < before / 10


def test_a_slope_of_light_is_less_biased_with_the_trend(light):
    # a lit wall ends at a dark one: beside the end all similar patches lie on one side
    x = np.arange(40)
    levels = np.where(x < 20, 0.5 + 0.004 * x, 0.05)[None].repeat(40, 0)
    samples = samples_of(film_of_samples(light(levels, 128)))
    truth = replace(samples, picture=levels[..., None].repeat(3, -1).astype(np.float32))
    column = (slice(8, -8), 19)
    bias = {
        trend: abs(fuse_scale(truth, FilterParameters(trend=trend)).picture[column].mean() - levels[0, 19])
        for trend in (False, True)
    }
    assert bias[True] < bias[False] / 3


def test_significantly_different_means_separate_pixels(rng):
    # a few samples in one wide bin: histograms cannot separate 1.0 from 1.15, the means can, by twelve deviations
    levels = np.where(np.arange(24) < 12, 1.0, 1.15)[None].repeat(20, 0)
    film = film_of_samples(levels[..., None, None] + rng.normal(0, 0.025, (20, 24, 8, 3)))
    errors = {
        welch: np.mean((fuse_scale(samples_of(film), FilterParameters(welch=welch)).picture - levels[..., None]) ** 2)
        for welch in (0.0, 3.0)
    }
    assert errors[3.0] < errors[0.0] / 10


def test_single_samples_are_compared_by_histograms_alone(light):
    frame = samples_of(film_of_samples(light(np.full((24, 24), 0.4), 1)))
    np.testing.assert_array_equal(
        fuse_scale(frame, FilterParameters()).picture, fuse_scale(frame, FilterParameters(welch=0.0)).picture
    )


def test_at_least_k_similar_patches_are_used(light, rng):
    # no similar patches: only the rule of the nearest applies
    film = film_of_samples(light(rng.permutation(np.geomspace(0.01, 7, 400)).reshape(20, 20), 256))
    alone = fuse_scale(samples_of(film), replace(PAPER, at_least=0, kappa=0.01))
    together = fuse_scale(samples_of(film), replace(PAPER, at_least=4, kappa=0.01))
    np.testing.assert_array_equal(alone.similar, 1)
    assert together.similar.min() >= 1 + 4 / 2  # the nearest have a weight of one half


def test_threads_do_not_change_the_result(light):
    film = film_of_samples(light(np.full((70, 30), 0.3), 16))
    one, three = (fuse_scale(samples_of(film), FilterParameters(), threads=n) for n in (1, 3))
    np.testing.assert_array_equal(one.picture, three.picture)
    np.testing.assert_array_equal(one.similar, three.similar)


def test_neighbouring_frames_contribute_their_samples(light):
    levels = np.full((30, 30), 0.4)
    frames = [samples_of(film_of_samples(light(levels, 32))) for _ in range(3)]
    alone = fuse_scale(frames[1], FilterParameters(kappa=3.0))
    with_others = fuse_scale(frames[1], FilterParameters(kappa=3.0), neighbours=[frames[0], frames[2]])
    inner = (slice(8, -8), slice(8, -8))
    np.testing.assert_allclose(with_others.similar[inner], 3 * alone.similar[inner], rtol=0.02)
    # three times the samples: sqrt(3) less noise; 1.4 allows for the few independent cells of a smoothed picture
    assert np.sqrt(((with_others.picture[inner] - 0.4) ** 2).mean()) < np.sqrt(
        ((alone.picture[inner] - 0.4) ** 2).mean()
    )


def test_frames_after_a_cut_contribute_nothing(light):
    frame, other = (samples_of(film_of_samples(light(np.full((20, 20), v), 64))) for v in (0.2, 3.0))
    alone = fuse_scale(frame, replace(PAPER, at_least=0))
    with_other = fuse_scale(frame, replace(PAPER, at_least=0), neighbours=[other])
    np.testing.assert_array_equal(alone.picture, with_other.picture)


def test_frames_of_different_sizes_are_refused(flat_film):
    frame = samples_of(flat_film)
    other = Samples(frame.picture[1:], frame.histogram[1:], frame.count[1:])
    with pytest.raises(BadInput, match="frames of different sizes"):
        fuse_scale(frame, FilterParameters(), neighbours=[other])


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"kappa": 0.0}, "kappa must be positive; got 0.0"),
        ({"kappa": float("nan")}, "got nan"),
        ({"patch": -1}, "patch must be 0 or more; got -1"),
        ({"softness": 1.5}, "softness must be between 0 and 1; got 1.5"),
    ],
)
def test_impossible_parameters_are_refused(wrong, says):
    with pytest.raises(BadParameter, match=says):
        FilterParameters(**wrong)
