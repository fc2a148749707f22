import numpy as np
import pytest

from station.demo.truth_comparison import align


def gaussian(x, y, k=17, sigma=1.8):
    """A PSF so broad that its samples carry all of it, and so narrow that its support does."""
    t = np.arange(k) - k // 2
    h = np.exp(-((t - x) ** 2 + (t[:, None] - y) ** 2) / (2 * sigma**2))
    return h / h.sum()


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.31, -0.12), (-0.8, 0.5)])
def test_known_shift_is_found_and_undone(shift):
    # band limit and support both cut the Gaussian at about 1e-4 of its peak
    aligned, found = align(gaussian(0, 0), gaussian(*shift))
    np.testing.assert_allclose(found, shift, atol=1e-3)
    np.testing.assert_allclose(aligned, gaussian(*shift), atol=1e-3 * gaussian(0, 0).max())


def test_shift_is_the_nearest_of_all(rng):
    truth = gaussian(0, 0)
    h = gaussian(0.2, 0.1) + 1e-3 * rng.normal(size=truth.shape)
    aligned, found = align(truth, h)
    for step in ((0.02, 0), (-0.02, 0), (0, 0.02), (0, -0.02)):
        shifted = gaussian(*(found + step))
        assert np.linalg.norm(h - aligned) < np.linalg.norm(h - shifted)
