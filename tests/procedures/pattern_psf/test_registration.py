from dataclasses import replace

import numpy as np

from procedures.pattern import X_CORNERS
from procedures.pattern_psf.registration import map_distance, mark_residuals, register_marks


def test_marks_are_registered_to_subpixel_and_hidden_ones_left_out(bench):
    corners, _ = bench.marks()
    truth = bench.photograph.true_points("Y", X_CORNERS)
    # undersampled corners of the 12-pixel blocks: a twentieth of a pixel each
    assert np.abs(corners - truth).max() < 0.08
    assert np.abs((corners - truth).mean(axis=0)).max() < 0.03
    _, registration = bench.marks()
    bent = replace(registration, displacement=np.linspace(-0.5, 0.5, 18).reshape(2, 9))
    cells = np.array([[0.0, 0.0], [256.0, 10.0], [128.0, 128.0], [3.0, 250.0]])
    assert np.abs(bent.to_pattern(bent.to_sensor(cells)) - cells).max() < 1e-6
    points, shift = np.array([[80.0, 90.0], [120.0, 70.0]]), np.array([0.3, -0.2])
    moved = bent.translated(shift).to_pattern(points)
    # the displacement's polynomial stays where it was: its slope of 0.01 per pixel times the shift
    assert np.abs(moved - bent.to_pattern(points + shift)).max() < 0.05
    moved = registration.translated(np.array([0.25, 0.0]))
    distance = map_distance(moved, registration, np.array([[100.0, 100.0]]))
    assert abs(distance - 0.25) < 0.01
    corners, registration = bench.marks()
    hidden = corners.copy()
    hidden[[2, 7]] = np.nan
    fewer = register_marks(hidden)
    assert mark_residuals(fewer, hidden).shape == (10, 2)
    assert map_distance(fewer, registration, np.array([[100.0, 100.0]])) < 0.05
