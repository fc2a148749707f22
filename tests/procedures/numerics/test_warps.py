from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procedures.numerics.warps import (
    CUBIC_EXPONENTS,
    CubicWarp,
    affine_between,
    apply_homography,
    cubic_monomials,
    displacement_columns,
    fit_homography,
    homography_jacobian,
)

H_TILTED = np.array([[2.1, 0.3, 40.0], [-0.2, 1.9, 55.0], [4e-4, -3e-4, 1.0]])
SQUARE = np.array([[0.0, 0.0], [256.0, 0.0], [256.0, 256.0], [0.0, 256.0], [128.0, 30.0]])


@given(st.floats(-3.2, 3.2), st.floats(0.1, 20), st.floats(-500, 500))
def test_fit_returns_the_homography_that_made_the_points(angle: float, scale: float, shift: float) -> None:
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    H = np.array([[c, -s, shift], [s, c, -shift], [1e-4, 2e-4, 1.0]])
    target = apply_homography(H, SQUARE)
    mapped = apply_homography(fit_homography(SQUARE, target), SQUARE)
    # rounding of 1e-16 through a linear system whose condition normalisation keeps near 1e3
    assert np.abs(mapped - target).max() < 1e-8 * (1 + np.abs(target).max())


def test_homographies_fit_in_the_target_with_their_jacobian(rng):
    target = apply_homography(H_TILTED, SQUARE) + rng.normal(0, 0.3, SQUARE.shape)

    def cost(H: np.ndarray) -> float:
        return float(np.sum((apply_homography(H, SQUARE) - target) ** 2))

    best = fit_homography(SQUARE, target)
    for _ in range(20):
        nearby = best * (1 + 1e-4 * rng.standard_normal((3, 3)))
        assert cost(best) <= cost(nearby)
    np.testing.assert_allclose(fit_homography(SQUARE[:4], apply_homography(H_TILTED, SQUARE[:4])), H_TILTED, atol=1e-9)
    with pytest.raises(ValueError, match="four points; got 3"):
        fit_homography(SQUARE[:3], SQUARE[:3])
    p, step = np.array([100.0, 60.0]), 1e-4
    moves = step * np.eye(2)
    slopes = (apply_homography(H_TILTED, p + moves) - apply_homography(H_TILTED, p - moves)).T / (2 * step)
    # central differences of a smooth map: the third derivative times step^2
    np.testing.assert_allclose(homography_jacobian(H_TILTED, p), slopes, rtol=1e-7)
    monomials = cubic_monomials(np.array([2.0]), np.array([3.0]))[0]
    assert monomials.tolist() == [2.0**i * 3.0**j for i, j in CUBIC_EXPONENTS]


def test_maps_are_inverted_displaced_and_derived(rng):
    bent = CubicWarp(H_TILTED, np.array([100.0, 60.0]), 80.0, 0.3 * rng.standard_normal((2, 9)))
    points = rng.uniform(40, 160, (50, 2))
    np.testing.assert_allclose(bent.backward(bent.forward(points)), points, atol=1e-6)
    points, change = rng.uniform(40, 160, (200, 2)), 1e-4 * rng.standard_normal((2, 9))
    monomials = bent.monomials(points)
    moves = np.stack([displacement_columns(np.eye(2)[[axis] * 200], monomials) @ change.ravel() for axis in (0, 1)], 1)
    # back in the source's units; the map's own displacement bends the moves by a hundredth
    shift = bent.displaced(change, monomials).forward(points) - bent.forward(points)
    local = np.linalg.solve(bent.derivative(points), shift[..., None])[..., 0]
    assert np.abs(local - moves).max() < 0.05 * np.abs(moves).max()
    assert np.abs(moves.mean(axis=0)).max() < 1e-12
    plain = replace(bent, displacement=np.zeros((2, 9)))
    np.testing.assert_allclose(plain.derivative(plain.centre[None])[0], plain.jacobian(), rtol=1e-6)


@pytest.mark.parametrize("size", [200, 600])  # as it is, and reduced for the first guess
def test_two_photographs_are_registered_whatever_their_brightness(rng: np.random.Generator, size: int) -> None:
    true = np.array([[1.002, 0.004, 7.3], [-0.003, 0.998, -4.6]])
    scene = 10 * cv2.GaussianBlur(rng.standard_normal((size, size + 40)), (0, 0), 3).astype(np.float32)
    moved = cv2.warpAffine(scene, true, scene.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    clear = np.ones(scene.shape, bool)
    clear[:, : size // 8] = False
    spoiled = np.where(clear, scene, 1.0).astype(np.float32)
    corners = np.array([(0.0, 0.0, 1.0), (size, 0.0, 1.0), (0.0, size, 1.0)]).T
    found = affine_between(spoiled, 0.3 + 2 * moved, clear)
    np.testing.assert_allclose(found @ corners, true @ corners, atol=0.2)  # what is spoiled is smoothed into its rim
    assert affine_between(scene, rng.standard_normal(scene.shape).astype(np.float32), clear) is None
