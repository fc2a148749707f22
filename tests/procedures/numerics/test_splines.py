"""The band-limited cell image compared with its definition: integrals of the cells times the sinc kernel."""

import numpy as np
import pytest

from procedures.numerics.splines import (
    Band,
    CellSpectra,
    cell_image_spline,
    outline_spline,
    photograph_spline,
    read_spline,
)

N = 32
PLAIN = (np.zeros(2), 1.0, np.zeros((2, 9)))


def read(coefficients: np.ndarray, per_cell: int, points: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """The spline at the cells (x, y) of an axis-parallel grid."""
    x, y = points
    grid = np.array([[per_cell, 0, -0.5], [0, per_cell, -0.5], [0, 0, 1.0]])
    start, step = np.array([x[0], y[0]]), float(x[1] - x[0])
    return read_spline(coefficients, grid, *PLAIN, start, step, (len(y), len(x)))


def fourier_series(cells: np.ndarray, x: np.ndarray, y: np.ndarray, band: float, footprint: str = "cell") -> np.ndarray:
    """Partial sum of the periodic cell image's Fourier series, each coefficient by the exact integral over a cell."""
    n = len(cells)
    highest = int(band * n)
    k = np.arange(-highest, highest + 1)
    centres = np.arange(n) + 0.5
    waves = np.exp(-2j * np.pi * np.outer(k, centres) / n)
    integral = np.sinc(k / n) / n
    coefficients = (waves * integral[:, None]) @ cells @ (waves * integral[:, None]).T
    across = np.exp(2j * np.pi * np.outer(x, k) / n)
    down = np.exp(2j * np.pi * np.outer(y, k) / n)
    return np.real(down @ coefficients @ across.T)


@pytest.mark.parametrize("band", [0.4, 0.9])
def test_spline_is_the_partial_fourier_series_of_the_cells(rng: np.random.Generator, band: float) -> None:
    cells = rng.integers(0, 2, (N, N)).astype(np.float64)
    coefficients = cell_image_spline(CellSpectra.of(cells), Band(N, 8, np.eye(2), band + 0.1 / N))
    x = np.arange(5.03, 25, 0.37)
    exact = fourier_series(cells, x, x, band)
    # the error of a cubic spline of 8 points per cell is (band / 8)^4 of its amplitude near the band's edge
    assert np.abs(read(coefficients, 8, (x, x)) - exact).max() < 2e-5 + 2 * (band / 8) ** 4


def test_cells_stay_constant_and_keep_the_band_of_the_target(rng):
    coefficients = cell_image_spline(CellSpectra.of(np.full((N, N), 0.3)), Band(N, 3, np.eye(2), 0.5))
    assert np.abs(coefficients - 0.3).max() < 1e-6  # float32
    turn = np.radians(30)
    J = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    impulse = np.zeros((N, N))
    impulse[N // 2, N // 2] = 1
    spectrum = np.abs(np.fft.fft2(cell_image_spline(CellSpectra.of(impulse), Band(N, 4, J, 0.4))))
    f = np.fft.fftfreq(4 * N, 0.25)
    along_target = np.stack([J[0, 0] * f + J[1, 0] * f[:, None], J[0, 1] * f + J[1, 1] * f[:, None]])
    outside = (np.abs(along_target) > 0.4).any(axis=0)
    assert spectrum[outside].max() < 1e-5 * spectrum.max()
    assert spectrum[~outside].min() > 0.05 * spectrum.max()
    # a cell of 1 on 0 grown by d on all sides gains its perimeter times d: 4 d for a lone cell
    cells = np.zeros((N, N))
    cells[10, 12] = 1
    outline = outline_spline(CellSpectra.of(cells), Band(N, 4, np.eye(2), 0.9))
    assert outline.sum() / 4**2 == pytest.approx(4, rel=1e-5)


def test_photographs_are_interpolated_between_their_pixels_and_shifted_by_a_map(rng):
    cells = rng.random((N, N))
    coefficients = cell_image_spline(CellSpectra.of(cells), Band(N, 4, np.eye(2), 0.4))
    x = np.arange(8.0, 20, 0.5)
    displacement = np.zeros((2, 9))
    displacement[0, 0], displacement[1, 4] = 0.02, 0.001  # 0.02 x right, 0.001 y^2 down
    grid = np.array([[4, 0, -0.5], [0, 4, -0.5], [0, 0, 1.0]])
    shape = (len(x), len(x))
    bent = read_spline(coefficients, grid, np.zeros(2), 1.0, displacement, np.array([8.0, 8.0]), 0.5, shape)
    one = read_spline(coefficients, grid, *PLAIN, np.array([x[7] * 1.02, x[9] + 0.001 * x[9] ** 2]), 1.0, (1, 1))
    assert bent[9, 7] == pytest.approx(one[0, 0], abs=1e-5)
    y, x = np.indices((90, 120), dtype=float)
    waves = [(0.11, 0.05, 0.3), (-0.04, 0.13, 1.1)]  # cycles per pixel along x and y, phase

    def image(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return sum(np.cos(2 * np.pi * (fx * x + fy * y) + phase) for fx, fy, phase in waves)

    coefficients, grid = photograph_spline(image(x, y).astype(np.float32), np.eye(2), 0.4)
    u, v = np.arange(30.2, 90, 0.7), np.arange(30.4, 60, 0.7)
    values = read_spline(coefficients, grid, *PLAIN, np.array([30.2, 30.4]), 0.7, (len(v), len(u)))
    # the spline errs by (f / its grid's Nyquist)^4, the band limit by the leakage of the mirrored rim beyond 0.4
    assert np.abs(values - image(u, v[:, None])).max() < 0.01


def test_photograph_loses_frequencies_beyond_the_band() -> None:
    y, x = np.indices((300, 300), dtype=float)
    fast = np.cos(2 * np.pi * (0.3 * x + 0.1 * y)).astype(np.float32)  # 1.5 cycles per target pixel along x
    coefficients, grid = photograph_spline(fast, 5 * np.eye(2), 1.0)
    low, high = (grid @ [at, at, 1.0] for at in (100, 200))
    inner = coefficients[int(low[1]) : int(high[1]), int(low[0]) : int(high[0])]
    # the wave reverses at the mirrored edge; 100 pixels from it 1 / (2 pi 100 (0.3 - 0.2)) of it remains
    assert np.abs(inner).max() < 0.03
