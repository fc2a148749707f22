"""What every rangefinder promises."""

import pytest

from drivers.errors import DeviceError, NoReading


@pytest.fixture
def rangefinder(rangefinder_rig):
    rangefinder_rig.device.connect()
    return rangefinder_rig.device


def test_it_measures_what_is_there(rangefinder, rangefinder_rig):
    readings = [rangefinder.measure().distance_mm for _ in range(5)]
    assert all(reading > 0 for reading in readings)
    if rangefinder_rig.bench is not None:
        from simulators.devices.instruments import HOUSING_MM

        true_mm = rangefinder_rig.bench.world.distance_mm(rangefinder_rig.clock.now_s()) + HOUSING_MM
        # noise of at most 0.6 mm and whole millimetres (0.3 mm): five standard deviations
        assert all(reading == pytest.approx(true_mm, abs=5 * 0.67) for reading in readings)


def test_it_says_when_it_measured(rangefinder, rangefinder_rig):
    before_s = rangefinder_rig.clock.now_s()
    reading = rangefinder.measure()
    assert before_s < reading.measured_s <= rangefinder_rig.clock.now_s()


def test_the_spot_can_be_switched(rangefinder, rangefinder_rig):
    for on in (True, False):
        rangefinder.laser(on)
        if rangefinder_rig.bench is not None:
            assert rangefinder_rig.bench.devices[rangefinder.address.rpartition("/")[2]].laser is on


def test_its_spot_is_off_once_it_has_connected_or_measured_and_when_it_is_closed(rangefinder, rangefinder_rig):
    if rangefinder_rig.bench is None:
        pytest.skip("a real one does not report its spot")
    twin = rangefinder_rig.bench.devices[rangefinder.address.rpartition("/")[2]]
    assert not twin.laser
    rangefinder.measure()
    assert not twin.laser
    rangefinder.laser(True)
    rangefinder.close()
    assert not twin.laser


@pytest.mark.parametrize("status", [1, 3, 4, 8, 10])
def test_what_it_cannot_measure_it_says_with_a_remedy(rangefinder, rangefinder_rig, status, request):
    if rangefinder_rig.bench is None:
        pytest.skip("a real one is not made to fail")
    rangefinder_rig.bench.devices[rangefinder.address.rpartition("/")[2]].status = status
    if status == 8 and "jrt" in request.node.name:
        assert rangefinder.measure().distance_mm > 0  # a weak echo is enough for its slow mode
        return
    with pytest.raises(NoReading) as failed:
        rangefinder.measure()
    assert failed.value.code == status
    assert failed.value.remedy


def test_silence_ends_in_an_error_within_its_deadline(rangefinder, rangefinder_rig):
    if rangefinder_rig.bench is None:
        pytest.skip("a real one is not silenced")
    now_s = rangefinder_rig.clock.now_s()
    rangefinder_rig.bench.cables[rangefinder.address.rpartition("/")[2]].faults.silent = ((now_s, now_s + 60.0),)
    with pytest.raises(DeviceError, match="did not answer"):
        rangefinder.measure()
    assert rangefinder_rig.clock.now_s() - now_s <= 13.5  # 5 s, and 8 s in slow mode
