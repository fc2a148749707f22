import numpy as np

from procedures.psf import Psf


def gaussian(sigma_px: float = 1.0, s: int = 4, k: int = 17, sd: float = 1e-4) -> Psf:
    """A PSF whose samples have white noise."""
    x = (np.arange(k) - k // 2) / s
    h = np.exp(-(x[:, None] ** 2 + x**2) / (2 * sigma_px**2))
    return Psf(h / h.sum(), s, np.eye(k * k) * sd**2)
