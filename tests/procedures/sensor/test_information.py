"""NEQ of a known sensor with a known PSF; sharpening and smoothing do not change it."""

import numpy as np
import pytest
import scipy.ndimage
import scipy.signal

from procedures.psf import Psf
from procedures.sensor.information import information
from procedures.sensor.spectrograms import measure_noise_power
from tests.psfs import gaussian

from .known_sensor import KnownSensor

S, K = 4, 17
KERNELS = {
    "sharpened": np.array([[0, -0.5, 0], [-0.5, 3.0, -0.5], [0, -0.5, 0]]),
    "smoothed": np.array([[1, 2, 1], [2, 8, 2], [1, 2, 1]]) / 20.0,
}
SENSOR = KnownSensor(rows=256, columns=256, prnu=0.0, dsnu_dn=0.0)
ELECTRONS = 20000.0


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    return [SENSOR.picture(ELECTRONS / SENSOR.efficiency, 0.01, rng).astype(float) for _ in range(4)]


def test_quanta_and_noise_power_follow_from_the_electrons(pictures, rng):
    noise = measure_noise_power(pictures, SENSOR.gain * ELECTRONS)
    found = information(gaussian(0.5, sd=1e-5), noise, rng)
    truth = ELECTRONS**2 / (ELECTRONS + SENSOR.dark_noise_e**2 + 1 / 12 / SENSOR.gain**2)
    zero = found.numbers["neq_zero"]
    assert abs(zero.value - truth) < 3 * zero.uncertainty
    expected = truth * np.exp(-4 * np.pi**2 * 0.25 * (found.frequencies**2)[None, :])
    z = (found.neq[0] - expected) / found.neq_uncertainty[0]
    assert np.abs(np.mean(z)) < 0.6
    assert np.sqrt(np.mean(z[0] ** 2)) < 2
    noise = measure_noise_power(pictures, 1.0)
    e = ELECTRONS
    variance = SENSOR.gain**2 * (e + SENSOR.dark_noise_e**2) + 1 / 12
    assert noise.power.mean() == pytest.approx(variance, rel=4 * (2 / (2 * 256 * 256)) ** 0.5 * 1.94)
    assert noise.blocks == 128


@pytest.mark.parametrize("name", list(KERNELS))
def test_filters_change_neither_quanta_nor_capacity(pictures, name):
    kernel = KERNELS[name]
    filtered = [scipy.ndimage.convolve(p, kernel, mode="wrap") for p in pictures]
    spread = np.zeros((2 * S + 1, 2 * S + 1))
    spread[::S, ::S] = kernel
    plain = gaussian(0.5, sd=1e-5)
    h = scipy.signal.convolve(plain.h, spread)  # wider by the kernel's reach
    psf = Psf(h, S, 1e-10 * np.eye(h.size))
    signal = SENSOR.gain * ELECTRONS
    before = information(plain, measure_noise_power(pictures, signal), np.random.default_rng(0))
    after = information(psf, measure_noise_power(filtered, signal), np.random.default_rng(0))
    assert np.abs(after.mtf / before.mtf - 1).max() > 0.5  # the MTF itself does change
    # the window smooths the spectrum over two of 32 frequencies: per cents where the filter's curvature is largest
    assert np.abs(after.neq / before.neq - 1).max() < 0.08
    assert np.abs(after.equivalent_mtf / before.equivalent_mtf - 1).max() < 0.05
    capacities = [one.numbers["information_capacity"] for one in (before, after)]
    assert capacities[1].value == pytest.approx(capacities[0].value, rel=0.002)


def test_capacity_follows_the_formula_wider_for_an_uncertain_psf(pictures, rng):
    # a point-like PSF transmits all frequencies: 1/2 log2(1 + NEQ / 3) everywhere
    point = Psf(np.ones((1, 1)), 4, np.zeros((1, 1)))
    small = KnownSensor(rows=64, columns=64, prnu=0.0, dsnu_dn=0.0)
    rng = np.random.default_rng(2)
    neq = 2000**2 / (2000 + 900 + 1 / 12 / 0.01)
    z, bits = [], []
    for _ in range(80):
        pair = [small.picture(2000 / small.efficiency, 0.01, rng) for _ in range(2)]
        found = information(point, measure_noise_power(pair, 200.0, 16), rng).numbers["information_capacity"]
        z.append((found.value - np.log2(1 + neq / 3) / 2) / found.uncertainty)
        bits.append(found.value)
    assert np.std(z) == pytest.approx(1, abs=0.3)
    assert np.mean(bits) == pytest.approx(np.log2(1 + neq / 3) / 2, rel=0.01)
    noise = measure_noise_power(pictures, SENSOR.gain * ELECTRONS)
    sure, unsure = (information(gaussian(0.5, sd=u), noise, rng).numbers["information_capacity"] for u in (1e-6, 3e-3))
    assert unsure.uncertainty > 2 * sure.uncertainty
    assert measure_noise_power([np.zeros((20, 100))] * 2, 1.0) is None
