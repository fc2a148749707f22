"""What every IMU promises."""

import numpy as np
import pytest

from drivers.errors import DeviceError

GRAVITY = 9.80665


@pytest.fixture
def imu(imu_rig):
    imu_rig.device.connect()
    return imu_rig.device


def test_it_streams_at_the_rate_asked_for(imu):
    imu.start(100.0)
    imu.read_block(0.2)
    block = imu.read_block(2.0)
    # two seconds of a stream that is handed over in batches of up to 32 ms
    assert len(block.device_s) == pytest.approx(200, abs=5)
    assert block.lost == 0
    np.testing.assert_allclose(np.diff(block.device_s), 0.01, atol=0.0011)  # WitMotion reports whole milliseconds


def test_both_clocks_run_alike(imu, imu_rig):
    imu.start(100.0)
    block = imu.read_block(2.0)
    assert np.all(np.diff(block.host_s) > 0)
    assert block.host_s[-1] <= imu_rig.clock.now_s() + 1e-6
    np.testing.assert_allclose(np.diff(block.host_s), np.diff(block.device_s))


def test_at_rest_it_feels_gravity(imu):
    imu.start(100.0)
    block = imu.read_block(2.0)
    # noise of 2 mg over 200 samples: 0.14 mg of the mean; one digit of 16 g / 32768 is 0.5 mg
    assert np.linalg.norm(block.acceleration_m_s2.mean(axis=0)) == pytest.approx(GRAVITY, abs=0.05)
    assert np.abs(block.rotation_rad_s.mean(axis=0)).max() < 0.01


def test_a_block_ends_where_the_next_begins(imu):
    imu.start(50.0)
    blocks = [imu.read_block(0.5) for _ in range(4)]
    times = np.concatenate([block.device_s for block in blocks])
    assert np.all(np.diff(times) > 0)
    np.testing.assert_allclose(np.diff(times), 0.02, atol=0.0011)


def test_stop_ends_the_stream(imu):
    imu.start(100.0)
    imu.read_block(0.5)
    imu.stop()
    imu.read_block(0.2)
    assert imu.read_block(0.5).device_s.size == 0


def test_a_rate_it_cannot_sample_is_refused(imu):
    with pytest.raises(DeviceError, match=r"use one of|another rate"):
        imu.start(123456.0)


def test_silence_is_an_error_not_an_empty_block(imu, imu_rig):
    if imu_rig.bench is None:
        pytest.skip("nobody pulls the cable of a real one here")
    imu.start(100.0)
    imu.read_block(0.2)
    now_s = imu_rig.clock.now_s()
    imu_rig.bench.cables[imu.address.rpartition("/")[2]].faults.silent = ((now_s, now_s + 10.0),)
    with pytest.raises(DeviceError, match="no samples"):
        imu.read_block(1.0)


@pytest.mark.slow
def test_it_feels_a_move_ring_down(imu, imu_rig):
    if imu_rig.bench is None:
        pytest.skip("nothing moves at a real one here")
    from simulators.world.motion import travel_line

    imu.start(200.0)
    axis = imu_rig.bench.world.axes["x_mm"]
    travel_line([axis], [axis.position(0.0) + 20.0], imu_rig.clock.now_s(), 50.0, 400.0)
    shaken, later = imu.read_block(1.0), (imu.read_block(4.0), imu.read_block(1.0))[1]
    assert shaken.acceleration_m_s2[:, 0].std() > 5 * later.acceleration_m_s2[:, 0].std()
