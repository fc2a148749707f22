"""The error of a PSF that a shift does not explain."""

import numpy as np
import scipy.optimize


def shifted(h: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """A PSF moved by (dx, dy) samples, by its Fourier series on twice its support."""
    k = len(h)
    f = np.fft.fftfreq(2 * k)
    wide = np.zeros((2 * k, 2 * k))
    wide[:k, :k] = h
    moved = np.fft.ifft2(np.fft.fft2(wide) * np.exp(-2j * np.pi * (f[:, None] * dy + f * dx)))
    return np.real(moved)[:k, :k]


def aligned_error(h: np.ndarray, truth: np.ndarray) -> tuple[float, np.ndarray]:
    """Relative L2 error after the best subpixel shift, and that shift in samples."""
    best = scipy.optimize.minimize(
        lambda d: np.sum((shifted(h, *d) - truth) ** 2),
        [0.0, 0.0],
        method="Nelder-Mead",
        options={"xatol": 1e-4, "fatol": 1e-12, "initial_simplex": [[0, 0], [0.1, 0], [0, 0.1]]},
    )
    return float(np.sqrt(best.fun) / np.linalg.norm(truth)), best.x
