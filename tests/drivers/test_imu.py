"""Loss is counted, whichever way the device reports it."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.imu import FastImu, ImuSample, WitImu, block_of
from drivers.protocols.imu import FastParser, WitParser
from drivers.transport import SerialTransport


@pytest.fixture
def wit(bench):
    imu = WitImu(SerialTransport(bench.address("imu"), WitParser, clock=bench.clock), clock=bench.clock)
    imu.connect()
    yield imu
    imu.close()


@pytest.fixture
def fast(bench):
    imu = FastImu(SerialTransport(bench.address("fast_imu"), FastParser, clock=bench.clock), clock=bench.clock)
    imu.connect()
    yield imu
    imu.close()


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


def test_the_least_late_sample_sets_the_offset_of_the_clocks():
    late = [ImuSample(float(t), t + 5.0 + delay, (0.0,) * 6) for t, delay in ((0, 0.3), (1, 0.1), (2, 0.2))]
    block = block_of(late, 0)
    np.testing.assert_allclose(block.host_s, [5.1, 6.1, 7.1])


def test_a_block_without_samples_is_empty_not_an_error():
    block = block_of([], 3)
    assert block.acceleration_m_s2.shape == (0, 3)
    assert block.lost == 3
