"""Depth maps cut along their edges: connected parts, and their extrapolation beyond the border."""

import numpy as np
import pytest

from procedures.restoration.first_depth.segments import extrapolate, joined, remove_blemishes, segments, surfaces


@pytest.fixture
def square():
    """A slope with a square half a pixel and more in front of it, and the mask of the square."""
    y, x = np.mgrid[0:80, 0:100]
    inside = (y > 35) & (x > 45)
    return 3.0 - 0.01 * x + 0.9 * inside, inside


def test_steps_cut_the_frame_into_segments_of_planes(square):
    w, inside = square
    labels = segments(w, 4, jump=0.35)
    assert labels.max() == 2
    assert len(np.unique(labels[inside])) == len(np.unique(labels[~inside])) == 1
    w, _ = square
    y, x = np.mgrid[0:80, 0:100]
    # ten pixels of the border are a ramp without an edge
    ramp = (np.abs(y - 60) < 5) & (np.abs(x - 45) < 6)
    w = np.where(ramp, 3.0 - 0.01 * x + 0.9 * np.clip((x - 39) / 12, 0, 1), w)
    labels = segments(w, 6, jump=0.35)
    assert labels.max() == 2
    assert labels[75, 95] != labels[5, 5]
    assert segments(1.0 + 0.02 * x + 0.02 * y, 4, jump=0.35).max() == 1
    w, inside = square
    blurred = np.where(np.abs(np.mgrid[0:80, 0:100][1] - 45) < 3, 3.2, w)  # a slightly smoothed edge
    known = inside.astype(np.int32) + 1
    labels = segments(blurred, 5, known, jump=2.0)
    # an edge of 2 would not be detected, and surfaces half that apart would be merged
    assert labels.max() == 1
    assert segments(blurred, 5, known, jump=1.0).max() == 2
    y, x = np.mgrid[0:40, 0:40]
    w = 2 + 0.02 * x - 0.01 * y
    # damped slopes: exact in the middle of the known part, some per cent low ten pixels outside
    result = extrapolate(w, (x < 20).astype(float), 5.0)
    np.testing.assert_allclose(result[15:25, 5:24], w[15:25, 5:24], atol=0.06)


def test_segments_meet_at_borders_and_lose_their_blemishes(square):
    w, inside = square
    result = surfaces(w, inside.astype(np.int32) + 1, 6, 2)
    near = result.near
    # both surfaces are one slope 0.9 apart, extrapolated by at most eight pixels; damped planes err by some hundredths
    assert near.any()
    np.testing.assert_allclose(np.abs(result.surface - result.other)[near], 0.9, atol=0.1)
    labels = np.ones((30, 60), np.int32)
    labels[:, 20:26], labels[:, 26:] = 2, 3
    w = labels.astype(float)
    first, second = (surfaces(w, labels, 12, 1, rank) for rank in (1, 2))
    assert first.other_label[15, 18] == 2
    assert second.other_label[15, 18] == 3
    w, inside = square
    spoilt = w.copy()
    spoilt[10:18, 70:80] = 1.0
    labels = inside.astype(np.int32) + 1
    np.testing.assert_allclose(remove_blemishes(spoilt, labels, 4), w, atol=0.1)
    np.testing.assert_array_equal(remove_blemishes(w, labels, 4), w)
    down, across = joined(np.array([[1, 1], [2, 2]], np.int32))
    assert not down.any()
    assert across.all()
