"""Where edges are looked for without a region."""

import numpy as np
import pytest
from scipy.special import ndtr

from procedures.slanted_edge.find import find_edges


@pytest.mark.parametrize("angle_deg", [5.0, 20.0, 30.0, 40.0])
@pytest.mark.parametrize("turned", [False, True])
def test_an_edge_from_side_to_side_of_the_picture_is_found_at_every_lean(
    angle_deg: float, turned: bool, rng: np.random.Generator
) -> None:
    y, x = np.mgrid[:150, :150] - 74.7
    lean = np.radians(angle_deg)
    picture = 0.1 + 0.5 * ndtr((x * np.cos(lean) - y * np.sin(lean)) / 0.6) + 0.005 * rng.standard_normal(x.shape)
    found = find_edges((picture.T if turned else picture).astype(np.float32))
    assert found[0].strip.turned == turned
    # half a degree is twice what segments are parallel to
    assert found[0].line.slope == pytest.approx(np.tan(lean), abs=0.01)
