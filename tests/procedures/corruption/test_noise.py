"""Unsharp masks found in noise that was white before them; what lenses and paper do to noise is none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from procedures.corruption.noise import Sharpening, Variogram, find_sharpening


def masked(noise: np.ndarray, amount: float, radius: float) -> np.ndarray:
    return noise + amount * (noise - cv2.GaussianBlur(noise, (0, 0), radius))


def found(*pictures: np.ndarray) -> Sharpening:
    return find_sharpening([Variogram.of(one, np.ones(one.shape, dtype=bool)) for one in pictures])


@pytest.mark.parametrize(("amount", "radius"), [(0.1, 0.7), (0.2, 1.0), (0.5, 0.5)])
def test_amount_and_radius_are_found(amount: float, radius: float, rng: np.random.Generator) -> None:
    look = found(masked(rng.standard_normal((300, 300)), amount, radius))
    assert look.sigmas > 5
    assert 0.7 < look.radius_px / radius < 1.5
    # amount and radius go together: a neighbouring radius of the grid explains the noise with two thirds of the amount
    assert amount / 1.6 < look.amount < 1.6 * amount


def test_uncertainty_is_the_scatter_of_amounts(rng: np.random.Generator) -> None:
    looks = [found(masked(rng.standard_normal((100, 100)), 0.3, 1.0)) for _ in range(30)]
    # the likelihood's root grows as amount over uncertainty; 30 of them are known to a fifth, their mean to 0.2
    expected = 0.3 / looks[0].uncertainty
    assert np.mean([one.sigmas for one in looks]) == pytest.approx(expected, rel=0.25)


def test_white_noise_is_not_sharpened(rng: np.random.Generator) -> None:
    sigmas = [found(rng.standard_normal((60, 60))).sigmas for _ in range(100)]
    assert np.quantile(sigmas, 0.5) < 1
    assert max(sigmas) < 4.0  # two of three thousand reach 3.3


def test_texture_through_a_lens_is_not_sharpening(rng: np.random.Generator) -> None:
    y, x = np.mgrid[:120, :120] / 120
    texture = cv2.GaussianBlur(rng.standard_normal((120, 120)), (0, 0), 0.8)
    assert found(rng.standard_normal((120, 120)) + texture + 8 * x - 5 * x * y).sigmas == 0


def test_rows_and_columns_that_err_are_not_sharpening(rng: np.random.Generator) -> None:
    noise = rng.standard_normal((120, 120))
    assert found(noise + 0.5 * rng.standard_normal(120) + 0.5 * rng.standard_normal((120, 1))).sigmas < 3


def test_unknown_pixels_do_not_count(rng: np.random.Generator) -> None:
    noise = rng.standard_normal((80, 80))
    known = rng.random((80, 80)) < 0.6
    with_rubbish = np.where(known, noise, 1e3)
    a, b = Variogram.of(noise, known), Variogram.of(with_rubbish, known)
    np.testing.assert_allclose(a.half_square, b.half_square)
    right = noise[3:, 2:] - noise[:-3, :-2]
    both = known[3:, 2:] & known[:-3, :-2]
    i = next(i for i, at in enumerate(zip(*_lags(), strict=True)) if at == (2, 3))
    assert a.half_square[i] == pytest.approx(np.mean(right[both] ** 2) / 2)


def test_finest_noise_is_that_of_white(rng: np.random.Generator) -> None:
    noise = 3 * rng.standard_normal((200, 200))
    smooth = cv2.GaussianBlur(rng.standard_normal((200, 200)), (0, 0), 1.5) * 5
    everywhere = np.ones(noise.shape, dtype=bool)
    # 40 000 differences: 1.1 % by the count
    assert Variogram.of(noise + smooth, everywhere).finest == pytest.approx(9, rel=0.04)
    assert Variogram.of(masked(noise, 0.1, 1.0), everywhere).finest == pytest.approx(9 * 1.21, rel=0.04)


def test_too_few_pixels_tell_nothing(rng: np.random.Generator) -> None:
    look = found(rng.standard_normal((15, 15)))
    assert look == Sharpening(0.0, 0.0, 0.0, np.inf)


def _lags() -> tuple[list[int], list[int]]:
    from procedures.corruption.noise import LAG_X, LAG_Y

    return LAG_X.tolist(), LAG_Y.tolist()
