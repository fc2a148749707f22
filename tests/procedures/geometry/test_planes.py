from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from procedures.geometry.estimate import GeometryParameters, is_too_simple
from procedures.geometry.planes import calibrate_planes

from .conftest import PLAIN, SMALL
from .simulated_views import CELL_MM, take


@pytest.mark.slow
def test_planes_share_a_model_unless_it_is_too_simple(taken, monkeypatch):
    monkeypatch.setattr("procedures.geometry.estimate.MODELS", ("OPENCV", "FULL_OPENCV", "THIN_PRISM_FISHEYE"))
    parameters = GeometryParameters(CELL_MM)
    bent = take(SMALL, np.random.default_rng(3))  # with thin-prism terms, unlike PLAIN
    blue = take(replace(SMALL, camera=PLAIN), np.random.default_rng(4))
    views = {"R": bent.views, "G1": taken.views, "B": blue.views}
    found = {
        name: one.value for name, one in calibrate_planes(views, PLAIN.size, parameters, nodes=taken.nodes).items()
    }
    assert found["B"].camera.model == found["G1"].camera.model
    assert found["R"].camera.model != found["G1"].camera.model
    assert not is_too_simple(found["R"])
