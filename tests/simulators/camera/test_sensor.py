import numpy as np
import pytest

from simulators.camera.sensor import Sensor

SMALL = {"rows": 40, "columns": 60}
N = 200_000


@pytest.mark.parametrize("mean_e", [0.0, 3.0, 120.0, 3000.0, 30000.0])
def test_variance_grows_with_light_as_photons_do(rng, mean_e):
    # photon transfer: var = mean + read^2; over n samples the variance's relative sd is sqrt(2 / n) (more for small
    # means, by 1 / mean), the mean's sd is sqrt(var / n); five of them
    sensor = Sensor(1, N, None, full_well_e=1e9, read_noise_e=4.0)
    electrons = sensor.electrons(np.full((1, N), mean_e), rng)
    variance = mean_e + 16
    assert electrons.mean() == pytest.approx(mean_e, abs=5 * (variance / N) ** 0.5)
    assert electrons.var() == pytest.approx(variance, rel=5 * ((2 + 1 / max(mean_e, 16)) / N) ** 0.5)


def test_numbers_are_electrons_over_gain_on_their_black_level(rng):
    sensor = Sensor(2, 2, "GRBG", 12, black=(10, 20, 30, 40), gain_e_per_dn=2.0)
    numbers = sensor.digitise(np.full((2, 2), 200.0))
    np.testing.assert_array_equal(numbers, [[110, 120], [130, 140]])


@pytest.mark.slow
def test_rounding_adds_the_noise_of_rounding(rng):
    sensor = Sensor(1, N, None, black=(64, 64, 64, 64), gain_e_per_dn=2.5, full_well_e=1e9, read_noise_e=10.0)
    numbers = sensor.expose(np.full((1, N), 1.0), 5000.0, rng)
    assert numbers.var() == pytest.approx((5000 + 100) / 2.5**2 + 1 / 12, rel=5 * (2 / N) ** 0.5)


def test_numbers_end_at_full_well_and_scale_with_each_colours_sensitivity(rng):
    sensor = Sensor(**SMALL, cfa=None, full_well_e=20000.0, gain_e_per_dn=2.0, read_noise_e=0.0, black=(100,) * 4)
    assert set(np.unique(sensor.expose(np.ones((40, 60)), 60000.0, rng))) == {10100}
    assert sensor.white == 10100
    sensor = Sensor(**SMALL, cfa=None, bits=10, full_well_e=1e6, gain_e_per_dn=1.0, black=(0,) * 4, read_noise_e=5.0)
    assert sensor.expose(np.ones((40, 60)), 5e4, rng).min() == 1023
    assert sensor.expose(np.zeros((40, 60)), 1.0, rng).min() == 0
    sensor = Sensor(**SMALL, black=(500, 510, 520, 530), read_noise_e=0.0, full_well_e=1e9)
    light = np.full((40, 60), 0.5)
    numbers = sensor.digitise(light * 1000 * sensor.gain_e_per_dn)
    linear = sensor.linear(numbers)
    for i, black in enumerate(sensor.black):
        np.testing.assert_allclose(linear[i // 2 :: 2, i % 2 :: 2], 500 / (sensor.white - black))
    sensor = Sensor(**SMALL, cfa="BGGR", black=(0,) * 4, gain_e_per_dn=0.1, full_well_e=1e9, read_noise_e=0.0, bits=16)
    numbers = sensor.expose(np.ones((40, 60)), 5000.0, rng)
    means = {name: numbers[y::2, x::2].mean() / 50000 for name, (x, y) in sensor.planes.items()}
    assert means == pytest.approx({"B": 0.7, "G1": 1.0, "G2": 1.0, "R": 0.6}, rel=0.01)


@pytest.mark.parametrize(
    ("cfa", "g1", "g2"),
    [("RGGB", (1, 0), (0, 1)), ("BGGR", (0, 1), (1, 0)), ("GRBG", (0, 0), (1, 1)), ("GBRG", (1, 1), (0, 0))],
)
def test_g1_is_the_green_on_the_red_rows(cfa, g1, g2):
    planes = Sensor(cfa=cfa).planes
    assert (planes["G1"], planes["G2"]) == (g1, g2)


def test_photosites_respond_unequally_by_curve_and_amplification(rng):
    sensor = Sensor(200, 200, None, prnu=0.02, read_noise_e=0.0, gain_e_per_dn=1.0, bits=16)
    frames = [sensor.expose(np.ones((200, 200)), 20000.0, rng).astype(float) for _ in range(2)]
    fixed = np.mean((frames[0] - frames[0].mean()) * (frames[1] - frames[1].mean())) ** 0.5
    # 40 000 photosites: the sd of an sd is 1 / sqrt(2 n) of it, and photon noise adds less than that
    assert fixed / 20000 == pytest.approx(0.02, rel=0.02)
    sensor = Sensor(1, 3, None, full_well_e=1e4, gain_e_per_dn=1.0, read_noise_e=0.0, curvature=0.1, black=(0,) * 4)

    class Still:  # no photon noise
        def standard_normal(self, shape, dtype):
            return np.zeros(shape)

        def poisson(self, mean):
            return mean

    read = sensor.electrons(np.array([[0.0, 5000.0, 10000.0]]), Still())
    np.testing.assert_allclose(read, [[0, 5250, 10000]])
    assert Sensor(gain_e_per_dn=2.4).at_iso(400).gain_e_per_dn == pytest.approx(0.6)
    with pytest.raises(ValueError, match="one R, two G and one B"):
        Sensor(cfa="RGBW")
    with pytest.raises(ValueError, match="10, 12, 14 or 16 bits"):
        Sensor(bits=11)
