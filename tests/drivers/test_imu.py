"""Loss is counted, whichever way the device reports it."""

import numpy as np
import pytest

from drivers.errors import BadConfiguration, Rejected
from drivers.imu import CableLatency, FastImu, StrigImu, WitImu
from drivers.protocols.imu import FastParser, WitParser


@pytest.fixture
def wit(wired):
    imu = wired(WitImu, WitParser, "imu")
    for _ in range(2):  # its version needs no stream: the second time it is silent
        assert imu.connect().firmware == "4405"
        imu.close()
    imu.connect()
    return imu


@pytest.fixture
def fast(wired):
    imu = wired(FastImu, FastParser, "fast_imu")
    imu.connect()
    return imu


def test_samples_a_wit_module_never_sent_show_as_gaps_in_its_time(wit, bench):
    bench.devices["imu"]._lose = 0.2
    wit.start(100.0)
    block = wit.read_block(4.0)
    # every gap between the first and the last sample is counted, so their sum is the time between them
    assert len(block.device_s) + block.lost == round((block.device_s[-1] - block.device_s[0]) * 100) + 1
    assert block.lost > 40


def test_batches_of_a_fast_imu_that_were_damaged_show_as_gaps_in_their_numbers(fast, bench):
    fast.start(1000.0)
    fast.read_block(0.1)
    faults = bench.cables["fast_imu"].faults
    now_s = bench.clock.now_s()
    faults.silent = ((now_s + 0.5, now_s + 0.7),)
    block = fast.read_block(1.0)
    # 200 samples fall into the silence; whole batches of 16 go with its edges
    assert block.lost == pytest.approx(200, abs=40)
    assert np.max(np.diff(block.device_s)) == pytest.approx(0.001 * (block.lost + 1), abs=0.02)


def test_a_wit_module_streams_unfiltered_and_with_its_time(wit, bench):
    wit.start(200.0)
    registers = bench.devices["imu"]._registers
    assert (registers[0x02], registers[0x03], registers[0x1F]) == (0x0007, 0x0B, 0x0000)


MAKERS = {"imu": (WitImu, WitParser), "fast_imu": (FastImu, FastParser)}


def time_error_s(imu, bench, block):
    """How late the block's host times are: its acceleration against the world's, at the true times of its samples."""
    if isinstance(imu, WitImu):
        return float(np.mean(block.host_s - block.device_s)) + 86400.0  # its calendar begins with the first of a month
    return float(np.mean(block.host_s - block.device_s / (1 + bench.devices["fast_imu"]._drift)))


@pytest.mark.parametrize("jitter_ms", [0.0, 3.0])
@pytest.mark.parametrize("delay_ms", [0.0, 4.0, 16.0, 40.0])
@pytest.mark.parametrize("name", MAKERS)
def test_the_time_of_a_sample_is_right_within_its_bound_on_a_delayed_cable(wired, bench, name, delay_ms, jitter_ms):
    imu = wired(*MAKERS[name], name)
    imu.connect()
    bench.cables[name].faults.delay_s, bench.cables[name].faults.jitter_s = delay_ms / 1000, jitter_ms / 1000
    imu.start(200.0)
    block = imu.read_block(1.0)
    late_s = time_error_s(imu, bench, block)
    assert block.clock.by == "round trip"
    assert abs(late_s) <= block.clock.within_s
    # all of the delay is on the way back here, the worst case of a round trip: half of it is wrong, and bounded
    assert late_s == pytest.approx(delay_ms / 2000, abs=0.003)
    assert block.clock.within_s < delay_ms / 2000 + 0.004


def test_a_measured_latency_takes_the_place_of_the_round_trip(wired, bench):
    imu = wired(WitImu, WitParser, "imu", latency=CableLatency(0.04, 0.001, "common event"))
    imu.connect()
    bench.cables["imu"].faults.delay_s = 0.04
    imu.start(200.0)
    block = imu.read_block(1.0)
    assert block.clock.by == "common event"
    assert abs(time_error_s(imu, bench, block)) <= block.clock.within_s < 0.003


def test_the_drift_of_a_unit_s_clock_is_measured_over_a_session(fast, bench):
    drift = bench.devices["fast_imu"]._drift = 200e-6
    fast.start(200.0)
    assert fast.read_block(1.0).clock.drift == 0.0  # too short to know more than a crystal's bound
    bench.clock.sleep(60.0)
    clock = fast.read_block(1.0).clock
    assert abs(clock.drift - drift) <= clock.drift_within < 100e-6


def test_a_unit_on_the_box_shares_the_clock_of_its_shutter(box, bench):
    imu = StrigImu(box, clock=bench.clock)
    imu.connect()
    bench.cables["shutter"].faults.delay_s = 0.04
    imu.start(200.0)
    times = box.fire(0.1)
    block = imu.read_block(0.2)
    imu.stop()
    opening = bench.body.openings[-1]
    # the round trip is wrong alike for both, so that the time from the flash to a sample is not
    late_s = times.flash_s - opening.begin_s
    assert 0.019 < abs(late_s) <= times.within_s
    began_s, drift = bench.devices["shutter"]._booted_s, bench.devices["shutter"]._drift
    truth = began_s + block.device_s / (1 + drift)
    assert np.abs((block.host_s - times.flash_s) - (truth - opening.begin_s)).max() < 1e-4
    assert np.abs(block.host_s - truth).max() <= block.clock.within_s
    assert block.lost == 0


def test_a_box_without_a_unit_says_so(box, bench):
    bench.devices["shutter"]._inertial = None
    with pytest.raises(Rejected, match="no inertial unit") as refused:
        StrigImu(box, clock=bench.clock).connect()
    assert "wire an inertial unit" in refused.value.remedy
    box.version = 3
    with pytest.raises(BadConfiguration, match="speaks STRIG/3, which has no inertial unit"):
        StrigImu(box, clock=bench.clock).connect()
