"""Classification of outliers as defective pixels or covered places."""

import numpy as np

from procedures.pattern_psf.observation import Observation
from procedures.pattern_psf.outliers import excluded_samples, within_levels


def observation(y: np.ndarray, noise: float = 0.01) -> Observation:
    """Observation of a whole square of samples."""
    rows, columns = (place.ravel() for place in np.indices(y.shape))
    points = np.column_stack([columns, rows]).astype(np.float64)
    flat, n = y.ravel(), y.size
    return Observation(rows, columns, points, flat, np.full(n, 1 / noise), np.zeros((n, 6)), np.zeros((n, 9)))


def test_single_samples_are_told_from_specks_and_from_what_no_light_makes():
    whole = observation(np.zeros((20, 20)))
    excluded = np.zeros((20, 20), dtype=bool)
    excluded[[0, 5, 19], [0, 7, 3]] = True  # at the rim, too
    excluded[10:12, 10:12] = True
    excluded[[15, 16], [15, 16]] = True  # corners touch
    counts = excluded_samples(whole, whole.where(~excluded.ravel()))
    assert counts.stray == 3
    assert counts.connected == 6 / 400
    # half of the contrast beyond white or black, and six standard deviations of noise
    y = np.array([[-0.57, -0.55, 0.0, 1.0, 1.55, 1.57]])
    assert within_levels(observation(y)).y.tolist() == [-0.55, 0.0, 1.0, 1.55]
