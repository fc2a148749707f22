import numpy as np
import pytest

from procedures.numerics.warps import apply_homography
from procedures.outcome import Refused
from procedures.two_photo import inter_image
from procedures.two_photo.inter_image import centre_of, common_region, fit_kernel
from procedures.two_photo.near_noise import noise_at_most, without_near_noise

from .conftest import OTF
from .wall import Pair, gaussian, photographs

S, K = 3, 13
OFF = np.array([[1, 0, 0.8], [0, 1, -0.7], [0, 0, 1.0]])
"""An initial map in error by 0.2 far pixels."""
DIRECTIONS = ((1, 0), (0, 1), (0.5**0.5, 0.5**0.5), (0.5**0.5, -(0.5**0.5)))


@pytest.mark.slow
def test_map_is_refined_to_a_hundredth_of_a_pixel_down_to_the_noise(pair):
    stretched = np.diag([1.002, 0.999, 1.0])
    fit = fit_kernel(pair.near, pair.far, OFF @ pair.H_near_far @ stretched, S, K)
    points = fit.samples.points
    off = (fit.warp.forward(points) - apply_homography(pair.H_near_far, points)) / 4.6
    # without the translation, which is the kernel's shift
    assert np.abs(off - off.mean(axis=0)).max() < 0.01
    fit = fit_kernel(pair.near, pair.far, pair.H_near_far, S, K)
    # 0.002 in both photographs; the near one adds c |k|^2, a few hundredths; 1e4 samples give 1 %
    assert np.sqrt(fit.variance) == pytest.approx(0.002, rel=0.06)


def test_light_and_shifts_are_eliminated_and_small_regions_refused(pair):
    x = np.linspace(-1, 1, pair.far.shape[1], dtype=np.float32)
    changed = pair.far * (1 + 0.1 * x + 0.05 * x[:, None] ** 2) + 0.02 * x[:, None]
    kernels = [fit_kernel(pair.near, far, pair.H_near_far, S, K).kernel for far in (pair.far, changed)]
    first, second = (kernel / kernel.sum() for kernel in kernels)
    assert np.linalg.norm(first - second) < 0.005 * np.linalg.norm(first)
    x = np.arange(K) - K // 2
    kernel = np.exp(-((x - 0.7) ** 2 + (x[:, None] + 1.2) ** 2) / (2 * 1.3**2))
    np.testing.assert_allclose(centre_of(kernel), [0.7, -1.2], atol=1e-3)  # the support truncates 1e-4
    with pytest.raises(Refused, match="need 353 far samples of the common region; it has"):
        common_region(pair.near[:90, :90], pair.far, pair.H_near_far, S, K)


def test_of_a_large_common_region_the_middle_is_used(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = common_region(pair.near, pair.far, pair.H_near_far, S, K)[0].points
    monkeypatch.setattr(inter_image, "MOST_SAMPLES", 2000)
    part = common_region(pair.near, pair.far, pair.H_near_far, S, K)[0].points
    # a square of at most 45 x 45 pixels, and a rim of one
    assert np.ptp(part, axis=0).max() <= 46
    np.testing.assert_allclose(part.mean(axis=0), whole.mean(axis=0), atol=1.0)


@pytest.mark.slow
def test_the_correction_removes_the_bias_by_near_noise() -> None:
    sharp, noise, f = gaussian(0.3, 0.3), 0.03, 0.9  # the wall has little power at high frequencies
    clean = photographs(sharp, noise=0.0, size=90)
    n = (np.arange(K) - K // 2) / S
    waves = np.array([np.cos(2 * np.pi * f * (c * n + s * n[:, None])).ravel() for c, s in DIRECTIONS])
    truth = sharp(f, 0) / sharp(f / 4.6, 0)
    transfers = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        near, far = ((p + noise * rng.standard_normal(p.shape)).astype(np.float32) for p in (clean.near, clean.far))
        fit = fit_kernel(near, far, clean.H_near_far, S, K)
        kernel = without_near_noise(fit, noise_at_most(near))
        assert kernel.noise == pytest.approx(noise, rel=0.03)
        transfers.append([(waves @ k).mean() / truth for k in (fit.kernel, kernel.k)])
    (plain, corrected), spread = np.mean(transfers, axis=0), np.std(transfers, axis=0).max() / 4
    assert plain < 1 - 2 * spread
    assert corrected - plain > 0.03
    assert abs(corrected - 1) < 2 * spread


@pytest.mark.slow
def test_noise_above_the_texture_is_refused() -> None:
    noisy = photographs(gaussian(0.6, 0.6), noise=0.06, size=90)
    fit = fit_kernel(noisy.near, noisy.far, noisy.H_near_far, S, K)
    with pytest.raises(Refused, match="noise must stay under the wall's texture"):
        without_near_noise(fit, noise_at_most(noisy.near))


@pytest.mark.parametrize("sigma", [0.003, 0.02])
def test_noise_of_a_bare_wall_is_measured(sigma: float, rng: np.random.Generator) -> None:
    bare = (0.4 + sigma * rng.standard_normal((400, 500))).astype(np.float32)
    assert noise_at_most(bare) == pytest.approx(sigma, rel=0.03)  # the median of 22 000 differences


def test_texture_increases_the_limit() -> None:
    assert noise_at_most(photographs(OTF, noise=0.002, size=60).near) > 0.002
