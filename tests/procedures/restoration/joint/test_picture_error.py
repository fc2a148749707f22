"""Expected error of the picture, and noise separated from errors of the masks, for simulated truth."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.restoration.joint.noise_and_contrast import BANDS
from procedures.restoration.joint.picture_error import error_map, noise_upper_bound, picture_error, residual_noise
from procedures.restoration.masks.blur_operator import MaskStack

N, NOISE, WEIGHT = 128, 0.003, 3e-3
W = np.full((N, N), 0.5)


def kernels(rng):
    """Two kernels of 7 x 7, thick and irregular."""
    random = gaussian_filter(rng.exponential(size=(2, 7, 7)) ** 3, (0, 0.5, 0.5))
    return random / random.sum(axis=(1, 2), keepdims=True)


def spectra(masks):
    wide = np.zeros((len(masks), N, N))
    wide[:, :7, :7] = masks
    return np.fft.fft2(np.roll(wide, (-3, -3), (1, 2)))


@pytest.fixture(scope="module")
def scene():
    """Half of it large smooth shapes, half also with texture; periodic."""
    rng = np.random.default_rng(5)
    u = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal((N, N)), 6, mode="wrap"))
    u[:, N // 2 :] += 1.5 * gaussian_filter(rng.standard_normal((N, N // 2)), 1)
    return u


@pytest.fixture(params=[0.0, 0.2, 0.5])
def restored(request, scene):
    """Truth, picture, residual and masks, each with a relative error of every sample."""
    return filtered(scene, request.param, WEIGHT)


def filtered(scene, wrong, weight, noise=NOISE):
    rng = np.random.default_rng(2)
    true = kernels(rng)
    measured = (true * (1 + wrong * rng.standard_normal(true.shape))).clip(0)
    measured /= measured.sum(axis=(1, 2), keepdims=True)
    z = np.fft.ifft2(spectra(true) * np.fft.fft2(scene)).real + noise * rng.standard_normal((2, N, N))
    H, Z = spectra(measured), np.fft.fft2(z)
    across = 2 - 2 * np.cos(2 * np.pi * np.fft.fftfreq(N))
    U = (H.conj() * Z).sum(axis=0) / ((np.abs(H) ** 2).sum(axis=0) + weight * (across[:, None] + across))
    residual = np.fft.ifft2(Z - H * U).real
    return np.fft.ifft2(U).real[None], residual[:, None], measured


def stacks(masks):
    return [MaskStack(np.stack([one, one]), 1.0) for one in masks]


def test_the_expected_error_is_the_error_and_two_deviations_hold_95_percent(scene, restored):
    u, residual, measured = restored
    error = picture_error(stacks(measured), W, np.full(BANDS, WEIGHT), residual, u, NOISE)
    # errors of masks are equal in picture and residual only on average over many masks
    assert error.std == pytest.approx(np.std(u[0] - scene), rel=0.3)
    assert error.std == pytest.approx(math.hypot(*error.budget.values()))
    assert error.blurred > 2 * error.std
    inside = np.abs(u[0] - scene) < 2 * error_map(error, residual, 7)
    # 95 % of a normal distribution; one pair of masks errs more or less in the picture than in the residual
    assert 0.85 < inside.mean() < 0.99


def test_noise_is_estimated_where_the_scene_is_smooth_and_is_no_error_of_the_masks(scene):
    rng = np.random.default_rng(3)
    noise = gaussian_filter(rng.standard_normal((2, 1, N, N)), (0, 0, 1, 1))
    noise *= NOISE / noise.std()
    z = np.stack([gaussian_filter(scene, 2)] * 2)[:, None] + noise
    # two photographs leave half of the noise; their highest frequencies contain a sixth of it
    residual_ = (noise - noise.mean(axis=0)) + 0 * scene
    assert residual_noise(z, residual_, scene[None], 3) == pytest.approx(NOISE, rel=0.15)
    assert noise_upper_bound(noise) < 0.3 * NOISE
    z = np.stack([gaussian_filter(scene, 2)] * 2)[:, None]
    noise = NOISE / 2**0.5 * rng.standard_normal(z.shape)
    # displaced masks leave a residual in proportion to the scene's gradient
    error = 0.05 * np.stack(np.gradient(scene))[:, None]
    assert error.std() > NOISE
    assert residual_noise(z, noise + error, scene[None], 3) == pytest.approx(NOISE, rel=0.25)


def test_noise_is_not_estimated_where_texture_is_everywhere():
    rng = np.random.default_rng(3)
    scene = gaussian_filter(rng.standard_normal((1, N, N)), (0, 1, 1))
    assert residual_noise(np.stack([scene, scene]), rng.standard_normal((2, 1, N, N)), scene, 3) == 0


@pytest.mark.parametrize("weight", [3e-3, 3e-2])
def test_detail_suppressed_by_the_prior_is_in_the_expected_error_of_known_masks(scene, weight):
    u, residual, masks = filtered(scene, 0.0, weight)
    true = np.std(u[0] - scene)
    error = picture_error(stacks(masks), W, np.full(BANDS, weight), residual, u, NOISE)
    # with the contrast as restored it is 1.15 and 0.92 of the error
    assert error.std == pytest.approx(true, rel=0.07)
    # the smooth half, then the textured one: their errors differ
    off = [np.std(part) for part in np.split(u[0] - scene, 2, axis=1)]
    stated = [np.sqrt(np.mean(part**2)) for part in np.split(error_map(error, residual, 7), 2, axis=1)]
    np.testing.assert_allclose(stated, off, rtol=0.25)


def test_what_exceeds_the_noise_is_a_disagreement_and_falls_with_more_light(scene):
    shares = []
    for wrong in (0.0, 0.5):
        u, residual, masks = filtered(scene, wrong, WEIGHT)
        error = picture_error(stacks(masks), W, np.full(BANDS, WEIGHT), residual, u, NOISE)
        shares.append(error.budget["shapes"] ** 2 / (error.budget["shapes"] ** 2 + error.budget["noise"] ** 2))
    assert shares[0] < 0.25
    assert shares[1] > 0.5
    best = min(np.logspace(-4, -1, 31), key=lambda weight: np.std(filtered(scene, 0.0, weight)[0][0] - scene))
    u, residual, masks = filtered(scene, 0.0, best)
    error = picture_error(stacks(masks), W, np.full(BANDS, best), residual, u, NOISE)
    u, *_ = filtered(scene, 0.0, best / 4, NOISE / 2)
    assert error.brighter == pytest.approx(np.std(u[0] - scene), rel=0.1)
    assert error.brighter < 0.8 * error.std
