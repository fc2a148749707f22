"""Sharpness of one photograph after the other, against the simulated camera's true MTF."""

from dataclasses import replace

import numpy as np
import pytest

from procedures import Chart, Plane
from procedures.pattern_psf.focus.sharpness import measure_sharpness
from procedures.pattern_psf.focus.sweep import best_focus
from simulators.camera.camera import Lens, SimulatedCamera, pixels_at, render_plane
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene
from tests.benchmarks.live_focus import true_mtf50

CHART = Chart.from_seed()
CAMERA = SimulatedCamera(Lens(focal_length_mm=50.0, f_number=4.0), Sensor(180, 260, cfa=None), pitch_um=8.0)
PLACED = CAMERA.place(CHART, pixels=pixels_at(1.3), at=(0.5, 0.5))
DISTANCE_MM = PLACED.pose.centre_mm[2]
DIOPTRES = 1000 / DISTANCE_MM + np.array([-0.02, -0.012, -0.003, 0.006, 0.014])
"""A bracket whose top lies between its places."""


def photograph(dioptres: float, rng: np.random.Generator) -> Plane:
    camera = replace(CAMERA, focus_mm=1000 / dioptres)
    return Plane("Y", render_plane(Scene((PLACED,)), camera, rng, exposure_s=0.008).astype(np.float32), 1 / 16383)


@pytest.mark.slow
def test_a_sweep_finds_the_best_focus_also_from_the_last_place(rng):
    seen, near = [], None
    for dioptres in DIOPTRES:
        found = measure_sharpness(photograph(float(dioptres), rng), CHART, near=near).result()
        near = found.sighting
        seen.append(found.mtf50)
    peak = best_focus(DIOPTRES, [one.value for one in seen], [one.uncertainty for one in seen])
    assert peak is not None
    best = max(true_mtf50(CAMERA, PLACED, float(d)) for d in np.linspace(DIOPTRES[0], DIOPTRES[-1], 49))
    assert true_mtf50(CAMERA, PLACED, peak.place) > 0.98 * best
    assert peak.score == pytest.approx(best, rel=0.02)
    plane = photograph(1000 / DISTANCE_MM, rng)
    first = measure_sharpness(plane, CHART).result()
    again = measure_sharpness(plane, CHART, near=first.sighting).result()
    # the marks are refined from another start: a hundredth of the noise
    assert again.mtf50.value == pytest.approx(first.mtf50.value, abs=0.05 * first.mtf50.uncertainty)


def test_a_frame_without_a_chart_says_so(rng):
    empty = Plane("Y", rng.normal(0.4, 0.01, (120, 160)).astype(np.float32), 1 / 1023)
    assert "no chart" in measure_sharpness(empty, CHART).reason
