import numpy as np
import pytest

from procedures import BadParameter, Psf, gaussian_constant
from procedures.restoration.masks.blur_models import spread_of
from procedures.restoration.masks.thin_lens import CameraSetting, relation

FIRST = CameraSetting(focal_length_mm=50.0, f_number=2.8, focus_mm=1500.0, pitch_um=6.0)


def test_blur_circles_and_distances_follow_the_thin_lens(rng):
    assert FIRST.blur_radius_px(1500.0) == pytest.approx(0)
    # (4.4): r = rho (l' - zeta) / l', l' where the distance is imaged
    distance = 900.0
    imaged = 1 / (1 / 50.0 - 1 / distance)
    r_mm = FIRST.aperture_radius_mm * (imaged - FIRST.image_distance_mm) / imaged
    assert FIRST.blur_radius_px(distance) == pytest.approx(r_mm / 6e-3)
    distances = np.array([600.0, 1200.0, 1500.0, 4000.0])
    np.testing.assert_allclose(FIRST.distance_mm(FIRST.blur_radius_px(distances)), distances)
    # (4.18): sigma_2 = alpha sigma_1 + k beta; a mask reaches to 3 sigma
    pairs = [[CameraSetting(50.0, 2.8, focus, 6.0, spread_of(name)) for focus in (1500.0, 1100.0)]
             for name in ("pillbox", "gaussian:0.6")]  # fmt: skip
    (alpha, beta), (same, wider) = (relation(*pair) for pair in pairs)
    assert (same, wider) == (pytest.approx(alpha), pytest.approx(1.8 * beta))
    with pytest.raises(BadParameter, match="k > 0"):
        spread_of("gaussian:-1")
    x = np.arange(-20, 21) / 2
    kernels = [np.exp(-(x[:, None] ** 2 + x**2) / (2 * (0.7 * r) ** 2)) for r in (1.5, 2.5, 4.0)]
    noisy = [one / one.sum() + 1e-4 * rng.standard_normal(one.shape) for one in kernels]
    psfs = [Psf(one / one.sum(), 2, np.eye(one.size) * 1e-8) for one in noisy]
    lens = gaussian_constant(psfs, [1.5, -2.5, 4.0])
    assert lens.k.value == pytest.approx(0.7, abs=3 * max(lens.k.uncertainty, 1e-3))
    with pytest.raises(BadParameter, match="1 pixel or more"):
        gaussian_constant(psfs, [0.5, 2.5, 4.0])
    assert np.isinf(FIRST.distance_mm(FIRST.blur_radius_px(np.inf) - 1))


@pytest.mark.parametrize(
    "second",
    [
        CameraSetting(50.0, 4.0, 1500.0, 6.0),
        CameraSetting(50.0, 2.8, 1100.0, 6.0),
        CameraSetting(55.0, 3.5, 900.0, 6.0),
    ],
)
def test_the_two_radii_are_linear_in_each_other(second):
    alpha, beta = relation(FIRST, second)
    distances = np.array([500.0, 800.0, 3000.0])
    np.testing.assert_allclose(second.blur_radius_px(distances), alpha * FIRST.blur_radius_px(distances) + beta)


def test_only_the_aperture_changed_leaves_the_ratio_of_f_numbers():
    assert relation(FIRST, CameraSetting(50.0, 5.6, 1500.0, 6.0)) == pytest.approx((0.5, 0.0))


@pytest.mark.parametrize("wrong", [(0, 2.8, 1500, 6), (50, 2.8, 40, 6)])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(BadParameter):
        CameraSetting(*map(float, wrong))
