"""Every number compared with the parameters of the simulated sensor; refusals by name."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from procedures.outcome import Verdict
from procedures.sensor.estimate import SensorResult, characterise, sensor_model
from procedures.sensor.information import linear_snr, total_snr
from procedures.sensor.photon_transfer import gain_and_noise
from procedures.sensor.uniformity import spatial_variances

from .known_sensor import SHARES, KnownSensor

SENSOR = KnownSensor(
    rows=160, columns=200, row_wave=(0.8, 0.0731), column_wave=(0.6, 0.2113), outliers=200, bend=0.01,
    dark_current_e_s=200.0,
)  # fmt: skip


FEWER = np.linspace(0.03, 1.2, 24)


def characterised(sensor: KnownSensor, seed: int = 7, **recorded: object) -> SensorResult:
    return characterise(sensor.record(seed, **recorded), np.random.default_rng(0)).result()


@pytest.fixture(scope="module")
def found() -> SensorResult:
    return characterised(SENSOR, exposures_s=(0.01, 1.0, 2.0))


def clipped_variance(mean: float, variance: float, top: float) -> float:
    """Variance of a normal variable clipped at the top."""
    s = variance**0.5
    a = (top - mean) / s
    below, density = norm.cdf(a), norm.pdf(a)
    first = mean * below - s * density + top * (1 - below)
    second = (mean**2 + variance) * below - (mean + top) * s * density + top**2 * (1 - below)
    return float(second - first**2)


def saturation_photons(sensor: KnownSensor) -> float:
    """Light of the largest temporal variance, from closely spaced noise-free levels."""
    light = np.array([sensor.photons_at(s) for s in np.linspace(0.9, 1.1, 801)])
    e = sensor.efficiency * light
    slope = 1 - 2 * sensor.bend * e / sensor.full_scale_e()
    mean = sensor.offset + sensor.gain * sensor.bent(e)
    variance = sensor.gain**2 * (slope**2 * e + sensor.dark_noise_e**2)
    at = np.argmax([clipped_variance(m, v, sensor.top) for m, v in zip(mean, variance, strict=True)])
    return float(light[at])


def truths() -> dict[str, float]:
    offset, response, places = SENSOR.patterns
    hot, good = np.zeros(offset.shape, bool), np.ones(offset.shape, bool)
    hot[tuple(places[:100].T)] = True
    good[tuple(places.T)] = False
    of_offset = spatial_variances(offset, (0, 0, 0), 1000).value
    at = saturation_photons(SENSOR)
    return {
        "system_gain": 0.1,
        "system_gain_at_dark": 0.1,
        "inverse_gain": 10.0,
        "temporal_dark_noise": 30.0,
        "quantum_efficiency": 0.6,
        "dark_current": 200.0,
        "dark_current_by_variance": 200.0,
        "saturation_photons": at,
        "saturation_capacity": 0.6 * at,
        "snr_max": (0.6 * at) ** 0.5,
        "linearity_error": SENSOR.linearity_error(SHARES, 1.0),
        "dsnu_dn": float(np.std(offset)),
        "dsnu_row_dn": of_offset["row"] ** 0.5,
        "dsnu_column_dn": of_offset["column"] ** 0.5,
        "dsnu_pixel_dn": of_offset["pixel"] ** 0.5,
        "dsnu_pixel_without_defects_dn": 1.5,
        "prnu": 100 * float(np.std(response) / np.mean(response)),
        "prnu_without_defects": 100 * float(np.std(response[good])),
        "defect_pixels_dark": 100,
        "defect_pixels_light": 100,
    }


@pytest.mark.slow
@pytest.mark.parametrize(("name", "truth"), truths().items())
def test_truth_lies_in_the_interval(found, name, truth):
    number = found.numbers[name]
    assert number.low <= truth <= number.high, (number, truth)


@pytest.mark.slow
def test_curvature_is_separated_from_gain_which_has_a_covariance_with_dark_noise(found):
    # 1 % of curvature is 1.5 % of K by a line; small signals are not affected
    assert found.transfer.gain_bent > 0.0005
    assert found.numbers["system_gain_at_dark"].uncertainty < 0.002 * 0.1
    assert found.numbers["system_gain"].uncertainty > 3 * found.numbers["system_gain_at_dark"].uncertainty
    together = gain_and_noise(found.transfer)
    for i, name in enumerate(together.NAMES):
        assert together.values[i] == found.numbers[name].value
        assert together.covariance[i, i] ** 0.5 == pytest.approx(found.numbers[name].uncertainty, rel=1e-9)
    # noise in electrons is noise in numbers over K: their errors are anticorrelated
    assert together.covariance[0, 1] < 0
    assert np.linalg.det(together.covariance) > 0


def test_every_outlier_is_named_and_no_other_pixel(found):
    named = [tuple(p) for one in (found.dark, found.light) for p in one.defects.places.tolist()]
    assert sorted(named) == sorted(map(tuple, SENSOR.patterns[2].tolist()))


@pytest.mark.slow
def test_both_sinusoids_are_detected_and_no_other(found):
    row, column = found.dark.periods
    for one, (pattern, (amplitude, frequency)) in zip(
        (row, column), (("row", SENSOR.row_wave), ("column", SENSOR.column_wave)), strict=True
    ):
        assert one.pattern == pattern
        assert one.frequency.value == pytest.approx(frequency, abs=3 * one.frequency.uncertainty)
        assert one.amplitude.value == pytest.approx(amplitude, abs=3 * one.amplitude.uncertainty)
    assert found.light.periods == ()


def test_the_spectrogram_contains_the_variance_and_the_model_inverts_the_response(found):
    # Parseval: the mean square over all frequencies, those folded counted twice, is the variance
    _, down = found.dark.spectrograms
    power = down.amplitude**2
    assert 2 * power[1:-1].sum() + power[[0, -1]].sum() == pytest.approx(
        SENSOR.rows * (found.numbers["dsnu_dn"].value ** 2 + 9.1 / 40), rel=0.02
    )
    model = sensor_model(found)
    e = np.linspace(0, 0.9, 50) * SENSOR.full_scale_e()
    straight = model.linearised(SENSOR.gain * SENSOR.bent(e))
    line = straight[-1] / e[-1] * e
    assert np.abs(straight - line).max() < 4 * model.bend_uncertainty * model.saturation
    assert np.abs(SENSOR.gain * SENSOR.bent(e) - straight).max() > 20


def test_on_a_linear_sensor_the_general_model_and_its_ratios_are_the_linear_ones():
    model = sensor_model(characterised(replace(SENSOR, bend=0.0, outliers=0), shares=FEWER, stack=0))
    signal = np.linspace(-10, 3900, 40)
    assert np.abs(model.linearised(signal) / model.linearised(signal)[-1] * 3900 - signal).max() < 4 * (
        model.bend_uncertainty * 3900
    )
    number = characterised(KnownSensor(rows=120, columns=120, row_noise_e=20.0), shares=FEWER).numbers["dsnu_row_dn"]
    # the pattern's random row averages are 1.5 DN / sqrt(120)
    assert number.low <= 1.5 / 120**0.5
    sensor = KnownSensor(rows=120, columns=120, prnu=0.02)
    result = characterised(sensor, shares=FEWER)
    e = np.array([900.0, 30_000.0])
    variance = e + sensor.dark_noise_e**2 + 1 / 12 / sensor.gain**2
    fixed = (sensor.dsnu_dn / sensor.gain) ** 2 + (sensor.prnu * e) ** 2
    light = e / sensor.efficiency
    # gain and dark noise are known to per cents
    np.testing.assert_allclose(linear_snr(result.transfer, light), e / np.sqrt(variance), rtol=0.03)
    total = total_snr(result.transfer, result.numbers, light)
    np.testing.assert_allclose(total, e / np.sqrt(variance + fixed), rtol=0.03)
    result = characterised(KnownSensor(rows=120, columns=120), shares=FEWER, stack=0)
    linear, general = (result.numbers[n] for n in ("sensitivity_threshold_photons", "general_threshold"))
    assert general.low <= linear.value <= general.high


def test_uneven_light_is_doubtful_and_excluded_from_the_highpass():
    sensor = KnownSensor(rows=120, columns=160, shading=0.05)
    outcome = characterise(sensor.record(2, FEWER, 20), np.random.default_rng(0))
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "over the sensor" in outcome.reason
    numbers = outcome.value.numbers
    assert numbers["prnu"].value > 1.4  # 5 % from side to side is 1.44 % of deviation
    # the smallest filter removes 1/77 of independent pixels' amplitude
    assert numbers["prnu_highpass"].value == pytest.approx(0.5, rel=0.02)


SMALL = KnownSensor(rows=60, columns=60)
REFUSED, DOUBTFUL = Verdict.REFUSED, Verdict.DOUBTFUL


@pytest.mark.parametrize(
    ("changes", "recorded", "verdict", "words"),
    [
        ({"flicker": 0.08}, {}, REFUSED, "must not change"),
        ({}, {"shares": np.linspace(0.05, 0.8, 20)}, REFUSED, "beyond saturation"),
        ({}, {"shares": [0.2, 0.5, 1.2]}, REFUSED, "at least 8 levels"),
        ({"offset": 2.0}, {}, REFUSED, "must not be clipped"),
        ({"shading": 0.4}, {}, REFUSED, "must be even"),
        ({}, {"exposures_s": ()}, REFUSED, "dark pictures is needed"),
        ({}, {"shares": [*np.geomspace(1e-3, 0.04, 8), 0.9, 1.3]}, REFUSED, "linearity needs"),
        ({"flicker": 0.01}, {}, DOUBTFUL, "between two pictures"),
        ({}, {"shares": np.linspace(0.05, 1.2, 12)}, DOUBTFUL, "standard requires 50"),
        ({}, {"stack": 0}, DOUBTFUL, "without a dark and flat stack"),
        ({}, {"stack": 5}, DOUBTFUL, "only 5 pictures"),
        ({"bend": 0.2}, {}, DOUBTFUL, "from a line"),
        ({}, {"exposures_s": (0.01,), "light_s": 2.0}, DOUBTFUL, "as long as"),
        ({}, {"shares": [0.0, *np.linspace(0.05, 1.2, 20)]}, REFUSED, "must be positive"),
        ({"dark_noise_e": 2.0, "dsnu_dn": 0.0}, {}, DOUBTFUL, "rounding dominates"),
    ],
)
def test_poor_pictures_are_refused_or_doubtful(changes, recorded, verdict, words):
    outcome = characterise(replace(SMALL, **changes).record(3, **recorded), np.random.default_rng(0))
    assert outcome.verdict is verdict
    assert words in outcome.reason
    assert outcome.remedy


def test_an_outlying_level_is_named():
    recording = SMALL.record(3, stack=0)
    lights = list(recording.lights)
    lights[30] = replace(lights[30], mean=lights[30].mean * 1.1)
    outcome = characterise(replace(recording, lights=tuple(lights[::-1])), np.random.default_rng(0))  # in any order
    assert outcome.verdict is Verdict.DOUBTFUL
    assert f"that of light {lights[30].light:g}" in outcome.reason
