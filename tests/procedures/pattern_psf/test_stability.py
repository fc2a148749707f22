"""Stability of repeated PSFs: the sensitivity of Gaussians is that of their analytic transfer functions."""

import numpy as np
import pytest

from procedures.outcome import BadParameter
from procedures.pattern_psf.stability import HALF, THRESHOLDS, stability_of

SIGMAS = (0.58, 0.60, 0.61, 0.63)


def gaussian(sigma, s, k):
    x = (np.arange(k) - k // 2) / s
    h = np.exp(-(x[:, None] ** 2 + x**2) / (2 * sigma**2))
    return h / h.sum(), s


def test_stable_domains_are_compared_in_the_common_band():
    stability = stability_of([gaussian(one, 4, 33) for one in SIGMAS], limit=0.04)
    r2 = stability.frequencies[:, None] ** 2 + stability.frequencies**2
    mtfs = np.exp(-2 * np.pi**2 * np.square(SIGMAS)[:, None, None] * r2)
    mean, std = mtfs.mean(axis=0), mtfs.std(axis=0, ddof=1)
    expected = [std[mean >= t].mean() / mean[mean >= t].mean() for t in THRESHOLDS]
    np.testing.assert_allclose(stability.sensitivity, expected, atol=2e-4)  # the support ends at 6.6 sigma
    numbers = {name: one.value for name, one in stability.numbers.items()}
    assert numbers["mtf_sensitivity"] == pytest.approx(expected[0], abs=2e-4)
    least = THRESHOLDS[np.flatnonzero(np.array(expected) <= 0.04)[0]]
    assert numbers["stable_mtf"] == pytest.approx(least)
    line = stability.mean[HALF, HALF:]
    end = float(np.interp(-least, -line, stability.frequencies[HALF:]))
    assert numbers["stable_frequency_horizontal"] == pytest.approx(end, abs=1e-6)
    stability = stability_of([gaussian(0.6, s, 8 * s + 1) for s in (3, 4, 5)])
    assert stability.frequencies[-1] == 1.5
    assert stability.numbers["mtf_sensitivity"].value < 0.01
    with pytest.raises(BadParameter, match="3 results or more"):
        stability_of([gaussian(0.6, 4, 33)] * 2)
