from dataclasses import replace

import numpy as np
import pytest

from procedures.geometry.adjustment import AdjustmentProblem
from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry
from procedures.geometry.shape import shape_model

from .simulated_views import CELL_MM, Shoot, Taken, TrueCamera, take

SMALL = Shoot(count=8, every=3, print_mm=0.03, bend_mm=0.3)
PLAIN = TrueCamera(radial=(-0.12, 0.06, 0.0), thin_prism=(0.0, 0.0, 0.0, 0.0))


@pytest.fixture(scope="session")
def taken() -> Taken:
    """Eight views of 8 x 8 nodes through a lens that OPENCV describes."""
    return take(replace(SMALL, camera=PLAIN), np.random.default_rng(3))


@pytest.fixture(scope="session")
def problem(taken: Taken) -> AdjustmentProblem:
    return AdjustmentProblem(taken.nodes, taken.views, shape_model(taken.nodes))


@pytest.fixture(scope="session")
def geometry(taken: Taken) -> Geometry:
    outcome = calibrate_geometry(
        taken.views, PLAIN.size, GeometryParameters(CELL_MM, model="OPENCV"), nodes=taken.nodes
    )
    assert outcome.reason == ""
    return outcome.result()
