"""What every device promises, whatever its kind."""

import pytest

from drivers.errors import DeviceError, LineLost


@pytest.mark.slow
def test_it_connects_closes_and_connects_again(device_rig):
    device = device_rig.device
    for _ in range(2):
        assert device.connect().model
        device.close()
        assert not device.condition().usable
        device.close()


def test_an_emergency_stop_never_raises(device_rig):
    device = device_rig.device
    device.emergency_stop()
    device.connect()
    device.emergency_stop()
    device.emergency_stop()
    device.close()
    device.emergency_stop()


def test_a_second_owner_of_the_line_is_refused(device_rig, request):
    if device_rig.bench is None or "camera" in request.node.name:
        pytest.skip("only lines of the simulated bench are opened twice here")
    device = device_rig.device
    device.connect()
    from drivers.shutter import NullParser
    from drivers.transport import SerialTransport

    with pytest.raises(LineLost, match=r"cannot open .* close other programs"):
        SerialTransport(device.address, NullParser, clock=device_rig.clock).open(lambda event, host_s: None)


def test_an_unplugged_cable_is_reported_and_repaired_by_connecting_again(device_rig, request):
    if device_rig.bench is None or "camera" in request.node.name:
        pytest.skip("only cables of the simulated bench are pulled here")
    device, clock = device_rig.device, device_rig.clock
    device.connect()
    faults = device_rig.bench.cables[device.address.rpartition("/")[2]].faults
    faults.unplugged_at_s, faults.replugged_at_s = clock.now_s() + 1.0, clock.now_s() + 2.0
    clock.sleep(1.5)
    assert not device.condition().usable
    with pytest.raises(DeviceError):
        device.connect()
    clock.sleep(1.0)
    device.connect()
