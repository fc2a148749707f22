import numpy as np
import pytest

from procedures.outcome import BadInput
from procedures.restoration.masks.line_rasterisation import path_mask


def test_masks_of_a_path_preserve_light_and_hold_its_motion():
    path = np.stack([np.linspace(-2.5, 3.0, 500), np.zeros(500)], axis=1)
    mask = path_mask(path, 5)
    assert mask.sum() == pytest.approx(1)
    assert (mask * np.arange(-5, 6)).sum() == pytest.approx(0.25, abs=1e-6)
    with pytest.raises(BadInput, match="leaves masks"):
        path_mask(np.array([[0.0, 0.0], [9.0, 0.0]]), 5)
