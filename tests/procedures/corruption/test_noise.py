"""Unsharp masks found in noise that was white before them; what lenses and paper do to noise is none."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.corruption.family import Strength, threshold
from procedures.corruption.noise import CONTRASTS, Variogram, mask_scores, texture_correlation


def masked(noise: np.ndarray, amount: float, radius: float) -> np.ndarray:
    return noise + amount * (noise - cv2.GaussianBlur(noise, (0, 0), radius))


def test_noise_is_that_of_the_known_pixels_alone(rng):
    noise = rng.standard_normal((80, 80))
    known = rng.random((80, 80)) < 0.6
    with_rubbish = np.where(known, noise, 1e3)
    a, b = Variogram.of(noise, known), Variogram.of(with_rubbish, known)
    np.testing.assert_allclose(a.half_square, b.half_square)
    right = noise[3:, 2:] - noise[:-3, :-2]
    both = known[3:, 2:] & known[:-3, :-2]
    i = next(i for i, at in enumerate(zip(*_lags(), strict=True)) if at == (2, 3))
    assert a.half_square[i] == pytest.approx(np.mean(right[both] ** 2) / 2)
    noise = 3 * rng.standard_normal((200, 200))
    smooth = cv2.GaussianBlur(rng.standard_normal((200, 200)), (0, 0), 1.5) * 5
    everywhere = np.ones(noise.shape, dtype=bool)
    # 40 000 differences: 1.1 % by the count
    assert Variogram.of(noise + smooth, everywhere).finest == pytest.approx(9, rel=0.04)
    assert Variogram.of(masked(noise, 0.1, 1.0), everywhere).finest == pytest.approx(9 * 1.21, rel=0.04)


def scores(pictures: list[np.ndarray], *nuisances: np.ndarray) -> list[Strength]:
    return mask_scores([Variogram.of(one, np.ones(one.shape, dtype=bool)) for one in pictures], (0.6, 1.0), nuisances)


def test_scores_have_a_standard_deviation_of_one_and_a_weak_mask_is_estimated(rng):
    found = np.array([[one.score for one in scores([rng.standard_normal((60, 60))])] for _ in range(200)])
    # a standard deviation from 200 is known to 5 %, its mean to 0.07
    np.testing.assert_allclose(found.std(axis=0), 1, atol=0.2)
    np.testing.assert_allclose(found.mean(axis=0), 0, atol=0.25)
    noise = [rng.standard_normal((400, 400)) for _ in range(2)]
    (_, found) = scores([masked(one, 0.05, 1.0) for one in noise])
    # linear in the amount: a twentieth is too large by some per cent
    assert found.value == pytest.approx(0.05, abs=3 * found.uncertainty + 0.005)
    assert found.score > 5
    alone = scores([masked(noise[0], 0.05, 1.0)])[1]
    assert found.uncertainty == pytest.approx(alone.uncertainty / 2**0.5, rel=0.01)
    assert scores([cv2.GaussianBlur(one, (0, 0), 0.4) for one in noise])[1].score < -5


@pytest.mark.parametrize("radius", [0.6, 1.5])
def test_a_mask_is_estimated_by_its_own_radius(radius: float, rng: np.random.Generator) -> None:
    picture = masked(rng.standard_normal((600, 600)), 0.05, radius)
    (found,) = mask_scores([Variogram.of(picture, np.ones(picture.shape, dtype=bool))], [radius])
    # its Gaussian is sampled, its correlations are linear in the amount: to a tenth
    assert found.value == pytest.approx(0.05, abs=3 * found.uncertainty + 0.005)
    assert found.score > 4


def test_what_is_fitted_as_well_is_no_mask_and_without_pairs_there_is_no_score(rng):
    noise = rng.standard_normal((400, 400)) + 0.5 * cv2.GaussianBlur(rng.standard_normal((400, 400)), (0, 0), 1.2) * 4
    f = np.linspace(0.01, 0.5, 50)
    texture = texture_correlation(f, np.exp(-2 * np.pi**2 * 1.2**2 * f**2))
    (_, plain), (_, fitted) = scores([noise]), scores([noise], texture)
    assert plain.score < -20
    assert abs(fitted.score) < 4
    assert fitted.uncertainty > plain.uncertainty
    (one, _) = scores([rng.standard_normal((15, 15))])
    assert (one.value, one.uncertainty, one.unseen) == (0.0, np.inf, 0.0)
    assert scores([]) == scores([np.zeros((80, 80))])
    assert Strength(0.5, 0.1).unseen == pytest.approx(threshold() * 0.1)
    assert Strength(0.1, 0.1).unseen == 0.1


def _lags() -> tuple[list[int], list[int]]:
    from procedures.corruption.noise import LAG_X, LAG_Y

    return LAG_X.tolist(), LAG_Y.tolist()


@pytest.mark.parametrize("lines", [False, True])
def test_texture_through_a_lens_and_lines_that_err_are_not_sharpening(lines: bool, rng: np.random.Generator) -> None:
    y, x = np.mgrid[:120, :120] / 120
    texture = cv2.GaussianBlur(rng.standard_normal((120, 120)), (0, 0), 0.8) + 8 * x - 5 * x * y
    err = 0.5 * rng.standard_normal(120) + 0.5 * rng.standard_normal((120, 1))
    assert max(one.score for one in scores([rng.standard_normal((120, 120)) + (err if lines else texture)])) < 3.5


@pytest.mark.parametrize("conversion", [cv2.COLOR_BayerBG2RGB, cv2.COLOR_BayerBG2RGB_EA])
def test_interpolated_pixels_have_less_of_the_finest_noise(rng: np.random.Generator, conversion: int) -> None:
    known = np.ones((120, 120), dtype=bool)
    limit = threshold(2 * len(CONTRASTS))
    mosaic = gaussian_filter(rng.standard_normal((120, 120)), 3) * 20 + 2 * rng.standard_normal((120, 120)) + 500
    assert Variogram.of(mosaic - 500, known).mosaic.score < limit
    for plane in cv2.split(cv2.cvtColor(mosaic.astype(np.uint16), conversion)):
        assert Variogram.of(plane - 500.0, known).mosaic.score > 2 * limit
