"""Coverage of the intervals, in draws."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.outcome import BadInput
from procedures.sensor.defects import from_draws, root, with_share
from procedures.sensor.estimate import ladder_checks
from procedures.sensor.spectrograms import find_periods
from procedures.sensor.stacks import bottom_pile, measure_level, measure_stack
from procedures.sensor.uniformity import spatial_variances

from .known_sensor import KnownSensor


def test_the_variance_of_a_level_is_that_of_noise_alone_from_pictures_enough(rng):
    # 400 pairs of 32 x 32 samples of variance 9: the stated variances against the spread, known to 1 / sqrt(800)
    levels = [measure_level(rng.normal(100, 3, (2, 32, 32)), 1.0, 1.0) for _ in range(400)]
    for name in ("mean", "variance"):
        values = [getattr(one, name) for one in levels]
        stated = np.mean([getattr(one, f"{name}_variance") for one in levels])
        assert np.var(values) == pytest.approx(stated, rel=4 / 800**0.5 * 1.4)
    assert np.mean([one.variance for one in levels]) == pytest.approx(9, abs=4 * (2 / 1023) ** 0.5 * 9 / 20)

    def pair() -> np.ndarray:
        return rng.normal(0, 1, (2, 64, 64)) + rng.normal(0, 1, (2, 64, 1))

    levels = [measure_level(pair(), 1.0, 1.0) for _ in range(300)]
    stated = np.mean([one.variance_variance for one in levels])
    assert np.var([one.variance for one in levels]) == pytest.approx(stated, rel=0.35)
    first = rng.normal(1000, 5, (100, 100))
    level = measure_level([first, rng.normal(1100, 5, (100, 100))], 1.0, 1.0)
    assert level.variance == pytest.approx(25, rel=4 * (2 / 10000) ** 0.5)
    assert level.change == pytest.approx(100, abs=0.5)
    with pytest.raises(BadInput, match="two pictures"):
        measure_level([rng.normal(0, 1, (4, 4))], 1.0, 1.0)
    with pytest.raises(BadInput, match=r"an array \(4, 4\); got an array \(1, 4\)"):
        measure_level([first[:4, :4], first[:1, :4]], 1.0, 1.0)
    with pytest.raises(BadInput, match="finite"):
        measure_stack([first, first * np.nan], 1.0, 1.0)
    with pytest.raises(BadInput, match="3 pictures or more; got 2"):
        measure_stack(rng.normal(0, 1, (2, 4, 4)), 1.0, 1.0)


@pytest.mark.parametrize(("offset", "crushed"), [(20, False), (0, True), (3, True)])
def test_clipping_at_the_lowest_number_is_detected(rng, offset, crushed):
    picture = np.clip(np.rint(rng.normal(offset, 3, (200, 200))), 0, None)
    assert (bottom_pile(picture) > 0.005) == crushed


def test_clipping_and_patterns_are_separated_from_temporal_noise(rng):
    assert bottom_pile(np.clip(np.rint(rng.normal(512, 3, (200, 200))), 512, None)) == pytest.approx(0.57, abs=0.02)
    rows, columns = 0.7 * rng.standard_normal((90, 1)), 0.4 * rng.standard_normal((1, 120))
    pixels = rng.standard_normal((90, 120))
    found = spatial_variances(rows + columns + pixels, (0.0, 0.0, 0.0), 100)
    for part, truth in (("row", rows), ("column", columns), ("pixel", pixels)):
        # averages of independent pixels vary by chance, which the uncertainty includes; their covariance with rows and
        # columns is twice the product over the root of their number
        assert found.value[part] == pytest.approx(np.var(truth), rel=0.06, abs=3 * found.uncertainty[part])
    assert sum(found.value[part] for part in ("row", "column", "pixel")) == pytest.approx(
        found.value["total"], rel=1e-3
    )
    pattern = rng.standard_normal((50, 60))
    inside = 0
    for _ in range(200):
        stack = measure_stack((pattern + rng.normal(0, 4, pattern.shape) for _ in range(10)), 1.0, 0.0)
        found = spatial_variances(stack.mean_picture, stack.residual_variance, stack.count)
        truth = float(np.var(pattern, ddof=1))
        inside += abs(found.value["total"] - truth) < 1.96 * found.uncertainty["total"]
    assert inside / 200 == pytest.approx(0.95, abs=3 * (0.95 * 0.05 / 200) ** 0.5)


def test_intervals_hold_their_numbers_at_zero_too(rng):
    inside = np.zeros(2)
    place = np.arange(150)[:, None]
    for _ in range(100):
        picture = rng.standard_normal((150, 40)) + 0.3 * np.sin(2 * np.pi * 0.1234 * place + 1)
        (found,) = find_periods(picture, "row", "DN")
        inside += [
            found.frequency.low <= 0.1234 <= found.frequency.high,
            found.amplitude.low <= 0.3 <= found.amplitude.high,
        ]
    assert inside / 100 == pytest.approx(0.95, abs=3 * 0.022)
    alarms = sum(len(find_periods(rng.standard_normal((128, 16)), "row", "DN")) for _ in range(300))
    assert alarms <= 3  # 1e-3 each: 0.3 are expected
    number = root(-0.1, 0.2, 1.0, "DN", "", 1)
    assert (number.value, number.low) == (0.0, 0.0)
    assert number.high > 0.5
    number = with_share(root(4.0, 0.4, 1.0, "DN", "", 1), 0.1)
    assert number.uncertainty == pytest.approx((0.1**2 + 0.2**2) ** 0.5)
    assert number.low < 1.62 < number.value < 2.38 < number.high


@pytest.mark.parametrize("spread", [0.1, 3.0])
def test_no_interval_of_a_positive_quantity_reaches_below_zero(spread):
    draws = np.array([1.0, 1 - spread, 1 + spread])
    number, signed = (from_draws(draws, "e-", "", 1, signed=one) for one in (False, True))
    assert 0 < number.low < number.value < number.high
    assert signed.low == pytest.approx(1 - 1.96 * spread)


@pytest.mark.parametrize(("amount", "failed"), [(0.0, set()), (0.1, {"sharpening"}), (-0.15, {"smoothing"})])
def test_a_camera_that_sharpens_or_smooths_is_found_by_the_noise_of_neighbouring_pixels(
    amount: float, failed: set[str]
):
    sensor = KnownSensor()
    recording = sensor.record(3, stack=0)
    lights = []
    for level in recording.lights:
        rng = np.random.default_rng(len(lights))
        pair = [sensor.picture(level.light, 0.01, rng).astype(float) for _ in range(2)]
        pair = [np.rint(one + amount * (one - gaussian_filter(one, 1.0))) for one in pair]
        lights.append(measure_level(pair, 0.01, level.light))
    found = {one.name for one in ladder_checks(replace(recording, lights=tuple(lights))) if one.fails}
    assert found & {"sharpening", "smoothing"} == failed
