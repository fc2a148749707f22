import numpy as np
import pytest
from scipy.integrate import quad

from procedures.pattern_psf.gamma import gamma_bound
from station.demo.reproduce import patterns


def test_gamma_of_patterns_follows_from_their_cells():
    # each pixel then sees one PSF sample: S C[u] is a permutation, all nine singular values are 1
    u = np.zeros((5, 5))
    u[2, 2] = 1
    assert patterns.gamma_of(u, 1, 3, (3, 3)) == pytest.approx(9.0, rel=1e-12)
    u[2, 2] = 0.5
    assert patterns.gamma_of(u, 1, 3, (3, 3)) == pytest.approx(36.0, rel=1e-12)
    u = np.ones((20, 20))
    sigma = patterns.singular_values(u, 2, 3, (8, 8))
    assert sigma[0] == pytest.approx(np.sqrt(64 * 9), rel=1e-12)  # rank one: sqrt(M N)
    assert sigma[1:].max() < 1e-12 * sigma[0]
    assert patterns.gamma(sigma) > 1e20
    assert patterns.gamma(np.array([2.0, 0.5])) == pytest.approx(0.25 + 4)
    assert patterns.gamma(np.array([1.0, 0.0])) == np.inf
    # samples of Bernoulli cells: mean 1/2, covariance 1/4 a(i) a(j), a the autocorrelation of a cell through the band
    r, window = 7, (70, 70)
    a = np.array([quad(lambda f, i=i: np.sinc(f) ** 2 * np.cos(2 * np.pi * f * i), -0.5, 0.5)[0] for i in range(r)])
    line = a[np.abs(np.subtract.outer(np.arange(r), np.arange(r)))]
    expected = 0.25 * np.kron(line, line) + 0.25
    M, N = window[0] * window[1], r * r
    analytic = np.trace(np.linalg.inv(expected)) / M * M / (M - N - 1)  # mean of the inverse of a Wishart matrix
    u = patterns.bernoulli(patterns.side(window, 4, r), 1.0, np.random.default_rng(1))
    # over ten seeds the values scatter by 0.8 %, and lie 1 % around this, as rows share samples
    assert patterns.gamma_of(u, 4, r, window) == pytest.approx(analytic, rel=0.05)
    u = patterns.of_cells(np.ones((40, 40)), 2.0, 9)
    assert u == pytest.approx(np.ones((9, 9)), abs=0.02)  # ringing of the band's edge, 20 cells away


def test_a_drawn_square_is_the_cell_of_its_size():
    cell = patterns.of_cells(np.ones((1, 1)), 4.0, 21)

    middle = 0.5 / patterns.FINE - 0.5  # where an odd picture's middle sample lies

    def draw(x, y):
        return ((x >= middle - 2) & (x < middle + 2) & (y >= middle - 2) & (y < middle + 2)).astype(float)

    drawn = patterns.of_drawing(draw, 21, 1)
    # 32 points to a side, their middle 1/16 sample before the cell's, on slopes of about 1 per sample
    assert np.abs(drawn - cell).max() < 0.08
    assert drawn.sum() == pytest.approx(cell.sum(), rel=0.01)


@pytest.mark.parametrize("draw", [patterns.slanted_edge, patterns.star(8), patterns.checkerboard(3.0)])
def test_no_pattern_goes_below_the_bound(draw):
    r, window = 5, (30, 31)
    u = np.clip(patterns.of_drawing(draw, patterns.side(window, 4, r), 4), 0, 1)
    assert patterns.gamma_of(u, 4, r, window) > gamma_bound(30 * 31, 25)


def test_the_solved_bound_is_the_least_on_its_curve():
    M, N = 400, 25
    t = np.linspace(0.01, 0.99, 100_001)
    curve = (1 / t**2 + (N - 1) ** 2 / (t * (1 - t))) / (M * N)
    assert patterns.gamma_bound_solved(M, N) == pytest.approx(curve.min(), rel=1e-9)
    assert gamma_bound(M, N) < patterns.gamma_bound_solved(M, N) < patterns.gamma_expected(M, N)
    with pytest.raises(ValueError, match=r"needs 41 samples; got \(20, 20\)"):
        patterns.system(np.ones((20, 20)), 4, 5, (10, 10))
