import numpy as np
import pytest

from procedures.numerics.kernel_tail import (
    EXCHANGED,
    FAR,
    KEPT,
    MIRRORED,
    SHAPES,
    far_light,
    tail_border,
    tail_columns,
    tail_density,
    tail_kernels,
    tail_spectra,
    tail_sums,
)

K = 9
LONG = 600


@pytest.fixture(scope="module")
def long_tail() -> np.ndarray:
    """1/r^3 outside the support up to many reaches, in units of the kernel's."""
    n = np.arange(-LONG, LONG + 1)
    r = np.hypot(n, n[:, None])
    inside = np.maximum(np.abs(n), np.abs(n[:, None])) <= K // 2
    tail = np.where(inside | (r > LONG), 0, 1 / np.maximum(r, 1) ** 3)
    reach = slice(LONG - tail_border(K), LONG + 1 + tail_border(K))
    return tail / tail[reach, reach][tail_kernels(K)[0] > 0].sum()


def test_sum_goes_on_without_an_end(long_tail: np.ndarray) -> None:
    # beyond R lies 1 / R of what lies beyond 1, and the circle's edge is a grid's
    beyond = (tail_sums(K)[0] - 1) * tail_border(K) / LONG
    assert long_tail.sum() + beyond == pytest.approx(tail_sums(K)[0], abs=0.001)


@pytest.mark.parametrize(("fx", "fy"), [(0.02, 0.0), (0.05, 0.03), (0.2, 0.11), (0.5, 0.5)])
def test_spectrum_is_that_of_the_long_kernel(long_tail: np.ndarray, fx: float, fy: float) -> None:
    n = np.arange(-LONG, LONG + 1)
    explicit = np.real(np.exp(-2j * np.pi * fy * n) @ long_tail @ np.exp(-2j * np.pi * fx * n))
    # what is cut off beyond the long kernel
    assert tail_spectra(np.array([fx]), np.array([fy]), K)[0, 0] == pytest.approx(explicit, abs=0.004)


def test_spectra_of_the_shapes_are_their_transforms() -> None:
    n = np.arange(-tail_border(K), tail_border(K) + 1)
    fx, fy = 0.07, -0.12
    wave = np.exp(-2j * np.pi * fy * n)[:, None] * np.exp(-2j * np.pi * fx * n)
    explicit = np.sum(tail_kernels(K)[1:] * wave, axis=(1, 2))
    np.testing.assert_allclose(tail_spectra(np.array([fx]), np.array([fy]), K)[0, 1:], explicit.real, atol=1e-12)
    np.testing.assert_allclose(explicit.imag, 0, atol=1e-12)


@pytest.mark.parametrize(("k", "reach"), [(9, 64), (33, 66)])  # 64 samples, or twice the support if that is more
def test_shapes_fall_as_their_names_say_and_vary_with_direction_alone(k: int, reach: int) -> None:
    kernels = tail_kernels(k)
    x = np.arange(-reach, reach + 1)
    r, angle = np.hypot(x, x[:, None]), np.arctan2(x[:, None], x)
    outside = (np.maximum(abs(x), abs(x[:, None])) > k // 2) & (r <= reach)
    assert kernels.shape == (len(SHAPES), len(x), len(x))
    assert not kernels[:, ~outside].any()
    np.testing.assert_allclose(kernels[:2].sum(axis=(1, 2)), 1)
    r, angle, (mean, close, *turning) = r[outside], angle[outside], kernels[:, outside]
    np.testing.assert_allclose(mean, tail_density(k) / r**3)
    np.testing.assert_allclose(close * r**5, (close * r**5).mean())
    waves = [np.cos(2 * angle), np.sin(2 * angle), np.cos(4 * angle), np.sin(4 * angle)]
    np.testing.assert_allclose(turning, mean * waves, atol=1e-15)


def test_spectra_and_columns_are_those_of_the_tails_shapes(rng):
    kernels = tail_kernels(K)
    np.testing.assert_allclose(kernels[:, :, ::-1], MIRRORED[:, None, None] * kernels, atol=1e-15)
    np.testing.assert_allclose(kernels[:, ::-1], MIRRORED[:, None, None] * kernels, atol=1e-15)
    np.testing.assert_allclose(kernels.transpose(0, 2, 1), EXCHANGED[:, None, None] * kernels, atol=1e-15)
    fx, fy = rng.uniform(-0.5, 0.5, (2, KEPT + 1))
    each = np.vstack([tail_spectra(fx[:9], fy[:9], K), tail_spectra(fx[9 : 9 + KEPT], fy[9 : 9 + KEPT], K)])
    np.testing.assert_allclose(tail_spectra(fx, fy, K)[: len(each)], each, atol=1e-14)
    np.testing.assert_allclose(tail_spectra(np.zeros(1), np.zeros(1), K)[0], tail_sums(K), atol=1e-12)
    s, border = 3, tail_border(K)
    u = rng.standard_normal((s * 9 + 1 + 2 * border, s * 12 + 1 + 2 * border)).astype(np.float32)
    rows, columns = (grid.ravel() for grid in np.mgrid[:10, :13])
    found = tail_columns(u, rows, columns, s, K)
    assert found.shape == (130, len(SHAPES))
    size = 2 * border + 1
    patches = np.lib.stride_tricks.sliding_window_view(u, (size, size))[::s, ::s].reshape(-1, size, size)
    for column, kernel in zip(found.T, tail_kernels(K), strict=True):
        seen = [np.sum(kernel[::-1, ::-1] * part) for part in patches]
        # single precision
        np.testing.assert_allclose(column, seen, atol=2e-5)
    np.testing.assert_array_equal(tail_columns(u, rows, columns, s, K, 2), found[:, :2])


def test_light_from_far_is_the_sum_over_the_pixels_in_units_of_each(rng):
    s, picture = 2, np.zeros((300, 280))
    spot = (150 + 60, 140 - 45)  # 75 pixels from the pixel that is asked
    picture[spot] = 1.0
    light = far_light(picture, (140, 150), (1, 1), s, K)[0, 0]
    # density per sample of the s grid, r in samples: per pixel s^2 times that, r in pixels over s^3
    assert light == pytest.approx(tail_density(K) / s / 75**3, rel=1e-9)
    picture[:] = 1.0
    # all around: a ring from the reach to FAR, by the integral of 2 pi r / r^3
    ring = 2 * np.pi * (s / tail_border(K) - 1 / FAR) * tail_density(K) / s
    assert far_light(picture, (140, 150), (1, 1), s, K)[0, 0] == pytest.approx(ring, rel=0.01)
    # the picture goes on beyond its edges as it ends there
    np.testing.assert_allclose(far_light(picture, (0, 290), (10, 20), s, K), ring, rtol=0.01)
    picture = rng.uniform(-0.5, 0.5, (150, 140))
    whole = far_light(picture, (20, 30), (40, 60), 2, K)
    raised = far_light(100 + 800 * (picture + 0.5), (20, 30), (40, 60), 2, K, levels=(100, 900))
    # single precision
    np.testing.assert_allclose(raised, whole, atol=1e-8)
    for row, column in ((0, 0), (39, 59), (7, 31)):
        (pixel,) = far_light(picture, (20 + column, 30 + row), (1, 1), 2, K)[0]
        assert whole[row, column] == pytest.approx(pixel, abs=1e-8)
