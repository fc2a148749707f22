"""Choice of the window for the search of motion paths."""

import numpy as np
import pytest

from procedures.restoration.unknown_motion.search_window import FLAT, search_window, within

FLAT_PART = (slice(10, 160), slice(20, 170))
HALF = 3.0


Z = np.random.default_rng(2).standard_normal((2, 1, 300, 400))
FLAT_W = np.full((300, 400), HALF)
SQUARE = np.pad(np.full((60, 70), 2.0), ((140, 100), (250, 80)), constant_values=HALF)


@pytest.mark.parametrize("pixels", [40_000, 60_000])
def test_a_window_holds_other_depths_and_some_of_the_flat_part(pixels):
    rows, columns = search_window(Z, FLAT_PART, HALF, SQUARE, pixels)
    assert (rows.stop - rows.start) * (columns.stop - columns.start) <= pixels
    assert rows.start <= 140
    assert rows.stop >= 200
    assert columns.start <= 250
    assert columns.stop >= 320
    y, x = within(FLAT_PART, (rows, columns))
    assert min(y.stop - y.start, x.stop - x.start) >= FLAT


def test_a_window_holds_the_flat_part_and_a_small_frame_completely():
    assert search_window(Z, FLAT_PART, HALF, SQUARE, 120_000) == (slice(0, 300), slice(0, 400))
    window = search_window(Z, FLAT_PART, HALF, FLAT_W, 40_000)
    y, x = within(FLAT_PART, window)
    assert min(y.stop - y.start, x.stop - x.start) >= FLAT
    window = (slice(40, 200), slice(5, 100))
    y, x = within(FLAT_PART, window)
    np.testing.assert_array_equal(Z[:, :, *window][:, :, y, x], Z[:, :, 40:160, 20:100])


def test_a_window_holds_nearer_and_farther_parts():
    w = FLAT_W.copy()
    w[:, 300:], w[160:240, 300:] = 2.0, 3.9
    rows, _ = search_window(Z, FLAT_PART, HALF, w, 40_000)
    assert rows.start < 140
    assert rows.stop > 200  # half of the nearer part, where most detail is farther
