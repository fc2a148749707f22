import numpy as np
import pytest

from procedures.pattern_psf.centre import _x_corner, mark_offset, mark_offset_gradient

S, K = 4, 17
J = np.array([[2.5, 0.4], [-0.3, 2.6]])


def blur(x0: float, y0: float, coma: float = 0.0) -> np.ndarray:
    x = (np.arange(K) - K // 2) / S
    h = np.exp(-((x - x0) ** 2) / 0.5 - ((x - y0)[:, None] ** 2) / 0.6)
    return h * (1 + coma * x * (x**2 + x[:, None] ** 2)) / h.sum()


@pytest.mark.parametrize(("x0", "y0"), [(0.0, 0.0), (0.1, -0.07), (-0.3, 0.2)])
def test_centre_of_symmetry_is_the_centre(x0: float, y0: float) -> None:
    # the Gaussian's tail cut by the support: exp(-8) on one side only
    np.testing.assert_allclose(mark_offset(blur(x0, y0), S, J), [x0, y0], atol=5e-4)


def test_a_mark_is_black_above_and_below_and_coma_moves_it_towards_its_tail(rng):
    mark = _x_corner(J, 8)
    y, x = np.mgrid[-8:9, -8:9]
    u, v = J @ np.array([x.ravel(), y.ravel()])
    inside = abs(abs(u) - abs(v)) > np.abs(J).sum()  # pixels that no edge crosses
    np.testing.assert_array_equal(mark.ravel()[inside], np.sign(abs(u) - abs(v))[inside])
    assert mark[8, 8] == pytest.approx(0, abs=0.1)
    offset = mark_offset(blur(0, 0, coma=0.3), S, J)
    assert 0.02 < offset[0] < 0.3
    assert abs(offset[1]) < 0.03
    h = blur(0.05, 0.02, coma=0.1)
    change = 1e-5 * rng.standard_normal(h.shape)
    difference = mark_offset(h + change, S, J) - mark_offset(h - change, S, J)
    # the offset ignores the sum: its gradient has no component along h
    found = mark_offset_gradient(h / h.sum(), S, J) @ (2 * change.ravel()) / h.sum()
    np.testing.assert_allclose(found, difference, rtol=1e-4)
