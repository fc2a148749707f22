"""Sagittal and meridional MTF over image height, compared with the simulated lens."""

import numpy as np
import pytest

from procedures.field.interpolate import interpolate
from procedures.field.maps import DIRECTIONS, over_height

from .lens import SHAPE

pytestmark = pytest.mark.slow

F = 0.2


def true_mtf(camera, height, directions):
    """Sagittal and meridional MTF (n, 2) at places that far from the frame's centre, along directions."""
    values = []
    for angle in directions:
        x, y = (SHAPE[1] - 1) / 2 + height * np.cos(angle), (SHAPE[0] - 1) / 2 + height * np.sin(angle)
        values.append([camera.mtf(x, y, np.array([F]), one)[0] for one in (angle + np.pi / 2, angle)])
    return np.array(values)


def test_the_lens_is_in_the_95_percent_band_up_to_where_the_nodes_end(camera, interpolated):
    (values,) = over_height(interpolated.field, (F,))
    curve = values
    turns = (np.arange(DIRECTIONS) + 0.5) * 2 * np.pi / DIRECTIONS
    off = []
    for i in np.flatnonzero(curve.directions == DIRECTIONS)[::2]:
        true = true_mtf(camera, curve.heights[i], turns)
        for kind, truth in zip(("sagittal", "meridional"), true.T, strict=True):
            value, spread = getattr(curve, kind)[i], getattr(curve, f"{kind}_uncertainty")[i]
            off.append((value - truth.mean()) / spread)
            # directions differ by the lens's decentring, and by their independent errors
            assert getattr(curve, f"{kind}_spread")[i] == pytest.approx(truth.std(), abs=2 * spread)
    assert len(off) >= 4
    assert np.abs(off).max() < 1.96
    assert curve.heights[0] == 0
    # the outermost nodes are twelve hundredths from the frame's rim
    assert 0.5 * SHAPE[0] * 0.76 < curve.heights[-1] < 0.5 * np.hypot(*SHAPE) * 0.76 + 1
    assert curve.directions[0] == 1
    assert 0 < curve.directions[-1] < DIRECTIONS


def test_nodes_on_one_side_give_no_heights_at_the_centre(measured):
    beside = [node for node in measured if node.position[0] > SHAPE[1] / 2 + 10]
    curves = over_height(interpolate("G1", SHAPE, beside).field, (F,))
    assert not curves or curves[0].heights[0] > 0
