"""A sensor calibrated by itself: its bent response is undone and not fitted, its noise weighs the samples."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from procedures import Chart, Plane, Verdict
from procedures.clipping import SensorModel
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.pattern_psf.radiometry import straighten

from .analytic_camera import View, circular, light

CHART = Chart.from_seed(1)
OPTICS = circular(1.14, blur_px=0.3)
SENSOR = SensorModel(
    gain=0.3, gain_uncertainty=0.001, dark_level=60.0, dark_variance=4.0, saturation=3800.0,
    signal_at_saturation=4000.0, bend=(-0.05,), bend_uncertainty=0.0003,
)  # fmt: skip


@cache
def plane(c1: float = -0.05, c2: float = 0.0, gain: float = 0.3) -> Plane:
    """The chart at 1.5 % to 75 % of saturation, the response x + c1 x^2 + c2 x^3, photon and read noise."""
    rng = np.random.default_rng(3)
    electrons = (60 + 2940 * light(OPTICS, CHART, View())) / gain
    x = rng.poisson(np.maximum(electrons, 0)) * gain / 4000
    numbers = 60 + 4000 * (x + c1 * x * x + c2 * x**3) + rng.normal(0, 2, x.shape)
    return Plane("Y", ((np.rint(numbers) - 60) / 4035).astype(np.float32), 1 / 4035, black=60.0, white=4095.0)


def found(sensor: SensorModel | None, photograph: Plane | None = None) -> PatternPsf:
    outcome = estimate_psf(photograph or plane(), CHART, PatternParameters(s=3, k=13), sensor=sensor)
    assert outcome.value is not None, outcome.reason
    return outcome.value


@pytest.mark.slow
def test_response_that_no_parabola_is_moves_the_psf_unless_it_is_known() -> None:
    # first steeper, then flatter; the truth is what the same light and noise give by a straight response
    bent, straight = plane(0.8, -1.0, 0.02), plane(0.0, 0.0, 0.02)
    sensor = replace(SENSOR, gain=0.02, bend=(0.8, -1.0))
    truth, with_it, without = found(None, straight), found(sensor, bent), found(None, bent)
    names = [f"mtf50_{direction}" for direction in ("horizontal", "vertical", "radial")]
    off = [
        max(abs(one.quality.numbers[name].value / truth.quality.numbers[name].value - 1) for name in names)
        for one in (with_it, without)
    ]
    assert off[1] > 1e-3
    assert off[0] < 0.2 * off[1]
    # an error of the response appears in the residual, too
    assert with_it.residual_std < 0.9 * without.residual_std


@pytest.mark.slow
def test_response_and_noise_are_the_sensors_and_white_beyond_saturation_is_refused():
    without, by_sensor = found(None), found(SENSOR)
    assert abs(without.diagnostics["response_curvature"]) > 0.02
    assert abs(by_sensor.diagnostics["response_curvature"]) < 3 * 4 * 0.0003
    budget = by_sensor.quality.budgets["mtf50_horizontal"]
    assert 0 < budget["sensor"] < without.quality.budgets["mtf50_horizontal"]["light"]
    assert without.quality.budgets["mtf50_horizontal"]["sensor"] == 0
    # the noise follows that model, so the residual has its size
    assert found(SENSOR).residual_std == pytest.approx(1, abs=0.03)
    # with four times the variance the normalised residual is half as large
    noisier = replace(SENSOR, gain=1.2, dark_variance=16.0)
    assert found(noisier).residual_std == pytest.approx(0.5, abs=0.02)
    outcome = estimate_psf(plane(), CHART, sensor=replace(SENSOR, saturation=2000.0))
    assert outcome.verdict is Verdict.REFUSED
    assert "97% of the sensor's saturation" in outcome.reason


def test_straightened_is_the_inverse_of_bent() -> None:
    straight = np.linspace(-20, 3900, 200)
    # the table's places are a 466th of the range apart: a parabola of 5 % is off by 5 % / 8 / 466^2
    assert SENSOR.linearised(SENSOR.bent(straight)) == pytest.approx(straight, abs=0.01)


@pytest.mark.slow
def test_straight_response_changes_nothing() -> None:
    same = straighten(plane(), replace(SENSOR, bend=()))
    assert same.samples == pytest.approx(plane().samples, abs=1e-6)


@pytest.mark.slow
def test_noise_beside_the_calibration_is_told() -> None:
    right = found(SENSOR).diagnostics
    # 13 000 differences, of which as many as 9/4 overlap, and a gain known to 0.3 %
    assert right["finest_noise"] == pytest.approx(1, abs=4 * right["finest_noise_uncertainty"])
    signal = plane()
    masked = signal.samples + np.float32(0.1) * (signal.samples - cv2.GaussianBlur(signal.samples, (0, 0), 1.5))
    parameters = PatternParameters(s=3, k=13, chosen=True)
    as_it_is, sharpened = (
        estimate_psf(replace(signal, samples=x), CHART, parameters, sensor=SENSOR) for x in (signal.samples, masked)
    )
    assert "sensor's calibration" not in as_it_is.reason
    assert sharpened.verdict is Verdict.DOUBTFUL
    assert "sensor's calibration: the picture was sharpened" in sharpened.reason
    assert sharpened.value is not None
    # a mask of 0.1 makes 1.1 of the finest detail
    assert sharpened.value.diagnostics["finest_noise"] == pytest.approx(1.21, rel=0.1)
