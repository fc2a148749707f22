"""Settling is detected by the IMU relative to its own noise, or by the decay time of the slowest mode."""

import math

import numpy as np
import pytest

from drivers.interfaces import ImuBlock
from simulators.world.clock import VirtualClock
from station.guide.vibration import NotSettled, Settling, SettlingTimeouts

NOISE = 0.02
PATIENCE = SettlingTimeouts()


class ShakenImu:
    """Noise at rest plus a damped oscillation that began at some time."""

    def __init__(self, clock, rng, *, began_s=0.0, sway=1.0, damping=0.03):
        self.clock, self.rng, self.began_s, self.sway, self.damping = clock, rng, began_s, sway, damping
        self.running = False

    def start(self, rate_hz):
        self.running, self.rate_hz = True, rate_hz

    def stop(self):
        self.running = False

    def read_block(self, duration_s):
        assert self.running
        t = self.clock.now_s() + np.arange(round(duration_s * self.rate_hz)) / self.rate_hz - self.began_s
        self.clock.sleep(duration_s)
        w = 2 * math.pi * 9.0
        force = self.rng.normal(0, NOISE, (len(t), 3))
        force[:, 0] += np.where(t >= 0, self.sway * np.exp(-self.damping * w * t) * np.cos(w * t), 0.0)
        return ImuBlock(t, t, force, self.rng.normal(0, 0.001, (len(t), 3)), 0)


def test_it_waits_until_the_oscillation_is_within_the_noise(rng):
    clock = VirtualClock()
    imu = ShakenImu(clock, rng, sway=0.0)
    settling = Settling(imu, clock)
    settling.wait()  # measures the level at rest
    imu.began_s, imu.sway = clock.now_s(), 2.0
    settling.moved()
    tremor = settling.wait()
    # the oscillation adds half its square over three axes; the limit is 1.4 times the noise, which scatters by 6 %
    left = 2.0 * math.exp(-imu.damping * 2 * math.pi * 9.0 * (clock.now_s() - imu.began_s))
    assert left**2 / 6 < ((1.4 * 1.12) ** 2 - 1) * NOISE**2
    assert tremor.acceleration_m_s2 < 1.5 * NOISE
    assert not imu.running


def test_at_rest_it_waits_for_one_window_only(rng):
    clock = VirtualClock()
    settling = Settling(ShakenImu(clock, rng, sway=0.0), clock)
    settling.wait()
    waits = []
    for _ in range(50):
        begin_s = clock.now_s()
        settling.wait()
        waits.append(clock.now_s() - begin_s)
    # one window each; noise alone exceeds 1.4 times the quietest window once in thousands
    assert np.mean(np.array(waits) < 1.5 * PATIENCE.window_s) > 0.95


def test_a_rig_that_never_settles_is_reported(rng):
    clock = VirtualClock()
    imu = ShakenImu(clock, rng, sway=0.0)
    settling = Settling(imu, clock)
    settling.wait()
    imu.sway, imu.damping = 1.0, 0.0
    with pytest.raises(NotSettled, match=r"after 20 s it still vibrates .* times as much as at rest"):
        settling.wait()


def test_without_an_imu_the_slowest_mode_is_given_time_to_decay(rng):
    clock = VirtualClock()
    settling = Settling(None, clock)
    settling.moved()
    assert settling.wait() is None
    left = math.exp(-2 * math.pi * PATIENCE.damping * PATIENCE.frequency_hz * clock.now_s())
    assert left == pytest.approx(PATIENCE.quiet)
    begin_s = clock.now_s()
    settling.wait()
    assert clock.now_s() == begin_s  # nothing has moved since
