"""Calibration patterns as functions, and the noise amplification gamma of their photographs.

A pattern u is band-limited, with s samples per pixel. In a photograph of m x n pixels each pixel is a sum of r x r
samples weighted by the PSF: a linear system with the M x N matrix S_s C[u], M = m n, N = r^2. gamma is the sum of
1 / sigma_i^2 over its singular values, the total variance of the PSF samples for noise of unit variance (thesis,
section 2.3.1).
"""

from collections.abc import Callable

import numpy as np
from scipy import fft, optimize, special

from procedures.numerics.arrays import Array

Window = tuple[int, int]
Drawing = Callable[[Array, Array], Array]
"""Reflectance, 0 to 1, at points (x, y) in pixels from the middle of the picture."""

FINE = 8
"""Oversampling along each axis with which patterns are drawn before they are band-limited."""
BEYOND = 16
"""Cells or samples around the picture that are drawn too: a band-limited picture extends over its edges."""


def side(window: Window, s: int, r: int) -> int:
    """Side in samples of the smallest square picture that determines all pixels of the window."""
    return s * (max(window) - 1) + r


def of_cells(cells: Array, samples_per_cell: float, samples: int) -> Array:
    """A centred pattern of square cells on black, exactly band-limited, (samples, samples).

    Each cell contributes the integral of the ideal low-pass filter over it: the filter c of the thesis, section 2.3.3.
    `samples_per_cell` is s/t.
    """
    across, down = (_cell_filter(n, samples_per_cell, samples) for n in reversed(cells.shape))
    return np.asarray(down @ cells @ across.T)


def _cell_filter(cells: int, samples_per_cell: float, samples: int) -> Array:
    """Weight of each cell in each sample, (samples, cells)."""
    at = (np.arange(samples) - (samples - 1) / 2) / samples_per_cell
    edges = np.arange(cells + 1) - cells / 2
    rise = special.sici(np.pi * samples_per_cell * (at[:, None] - edges))[0] / np.pi
    return np.asarray(rise[:, :-1] - rise[:, 1:])


def bernoulli(samples: int, samples_per_cell: float, rng: np.random.Generator, cells: int | None = None) -> Array:
    """The noise pattern: random black and white cells; `cells` along a side, by default enough for the picture."""
    n = cells or int(np.ceil(samples / samples_per_cell)) + BEYOND
    return of_cells(rng.integers(0, 2, (n, n)).astype(np.float64), samples_per_cell, samples)


def of_drawing(draw: Drawing, samples: int, s: int) -> Array:
    """A drawn pattern, band-limited to half a cycle per sample, (samples, samples), s samples per pixel."""
    n = samples + 2 * BEYOND
    x = ((np.arange(n * FINE) + 0.5) / FINE - n / 2) / s
    fine = draw(x[None, :], x[:, None])
    fy, fx = fft.fftfreq(n * FINE)[:, None], fft.rfftfreq(n * FINE)[None, :]
    kept = (np.abs(fy) < 0.5 / FINE) & (np.abs(fx) < 0.5 / FINE)
    limited = fft.irfft2(np.where(kept, fft.rfft2(fine), 0), fine.shape)
    return np.asarray(limited[::FINE, ::FINE][BEYOND:-BEYOND, BEYOND:-BEYOND])


def slanted_edge(x: Array, y: Array) -> Array:
    """One edge, five degrees off the vertical."""
    return np.where(x > np.tan(np.radians(5.0)) * y, 1.0, 0.0)


def disc(radius_px: float) -> Drawing:
    """The pattern of Joshi et al. locally: arcs of 120 degrees that form a circle."""
    return lambda x, y: np.where(np.hypot(x, y) < radius_px, 0.0, 1.0)


C, S = np.cos(np.radians(5.0)), np.sin(np.radians(5.0))
"""Slight rotation by which edges cross pixels at all positions."""


def checkerboard(side_px: float) -> Drawing:
    """Squares, rotated."""
    return lambda x, y: (np.floor((C * x + S * y) / side_px) + np.floor((C * y - S * x) / side_px)) % 2


def star(spokes: int) -> Drawing:
    """Siemens' star."""
    return lambda x, y: np.where(np.sin(spokes * np.arctan2(y, x)) > 0, 1.0, 0.0)


def square(side_px: float) -> Drawing:
    """One white square on black, rotated as the checkerboard."""
    return lambda x, y: np.where(np.maximum(abs(C * x + S * y), abs(C * y - S * x)) < side_px / 2, 1.0, 0.0)


def system(u: Array, s: int, r: int, window: Window) -> Array:
    """S_s C[u], (m n, r^2): a row for each pixel of the window, a column for each PSF sample (reversed)."""
    patches = np.lib.stride_tricks.sliding_window_view(u, (r, r))
    m, n = window
    rows = patches[: s * (m - 1) + 1 : s, : s * (n - 1) + 1 : s]
    if rows.shape[:2] != window:
        raise ValueError(f"a window of {window} pixels needs {side(window, s, r)} samples; got {u.shape}")
    return rows.reshape(m * n, r * r)


def singular_values(u: Array, s: int, r: int, window: Window) -> Array:
    """Singular values of S_s C[u] in descending order, (r^2,)."""
    return np.asarray(np.linalg.svd(system(u, s, r, window), compute_uv=False))


def gamma(sigma: Array) -> float:
    """Sum of 1 / sigma_i^2, infinite for a singular system."""
    with np.errstate(divide="ignore"):
        return float(np.sum(1.0 / sigma**2))


def gamma_of(u: Array, s: int, r: int, window: Window) -> float:
    """gamma of a window on a pattern."""
    return gamma(singular_values(u, s, r, window))


def gamma_bound_solved(M: int, N: int) -> float:
    """The bound with the exact solution of its constrained minimum (Remark 3, Karush-Kuhn-Tucker), a = 0, b = 1. With
    sigma_1 = t sqrt(M N) the constraint is (N - 1) sigma_2^2 = M N t (1 - t); one variable remains."""
    least = optimize.minimize_scalar(
        lambda t: 1 / t**2 + (N - 1) ** 2 / (t * (1 - t)), bounds=(0.01, 0.99), method="bounded",
        options={"xatol": 1e-12},
    )  # fmt: skip
    return float(least.fun) / (M * N)


def gamma_expected(M: int, N: int) -> float:
    """Gamma of the expected matrix S'S of Bernoulli(0.5) samples, a = 0, b = 1 (thesis, before Figure 2.3)."""
    return 4 / M * (1 / (N + 1) + (N - 1))
