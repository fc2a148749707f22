from pathlib import Path

import numpy as np
import pytest

from procedures.pattern import Chart
from simulators.bench.demonstration import EXPOSURE_S, ISO, Staging, stage


@pytest.fixture(scope="session")
def chart_photograph():
    """chart_photograph(path, seed): a small DNG of one chart, with noise of its own."""
    camera, scene = stage(Staging("small", "Small", (0.5, 0.5), 1.0, rows=260, columns=260), Chart.from_seed())
    light = camera.light(scene)

    def expose(path: Path, seed: int = 0, exposure_s: float = EXPOSURE_S) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        camera.photograph(scene, np.random.default_rng(seed), path, exposure_s=exposure_s, iso=ISO, light=light)
        return path

    return expose
