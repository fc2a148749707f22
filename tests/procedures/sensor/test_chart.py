"""A camera with a nonlinearity of 5 %, calibrated by even light, then used with the chart."""

import numpy as np
import pytest

from procedures import Chart, Plane, Verdict, estimate_psf
from procedures.sensor.estimate import characterise, sensor_model

from ..pattern_psf.analytic_camera import View, circular, light, mtf50
from .known_sensor import KnownSensor

CHART = Chart.from_seed(1)
OPTICS = circular(1.62, fill=0.9)
SENSOR = KnownSensor(rows=176, columns=176, bend=0.05, dark_noise_e=10.0, dsnu_dn=0.5)


@pytest.mark.slow
def test_psf_with_the_sensors_own_result_is_the_cameras():
    recording = SENSOR.record(1, np.linspace(0.03, 1.25, 30), 20)
    model = sensor_model(characterise(recording, np.random.default_rng(0)).result())
    photons = SENSOR.photons_at(1) * (0.02 + 0.7 * light(OPTICS, CHART, View()))
    numbers = SENSOR.picture(np.maximum(photons, 0), 0.01, np.random.default_rng(2))
    plane = Plane("Y", ((numbers - 64.0) / 4031).astype(np.float32), 1 / 4031, black=64.0, white=4095.0)
    with_it, without = (estimate_psf(plane, CHART, sensor=one) for one in (model, None))
    assert with_it.verdict is Verdict.PASS, with_it.reason
    truth = mtf50(OPTICS)
    for outcome in (with_it, without):
        number = outcome.value.quality.numbers["mtf50_horizontal"]
        assert abs(number.value - truth) < 3 * number.uncertainty
    # the nonlinearity is removed, to better than the chart alone determines it
    curvatures = [one.value.diagnostics["response_curvature"] for one in (with_it, without)]
    assert abs(curvatures[0]) < 0.2 * abs(curvatures[1])
    # the printed chart adds some per cent to the noise
    assert with_it.value.residual_std == pytest.approx(1, abs=0.15)
