"""The Zaber twin, driven by the vendor's own library: a client that shares no line with ours."""

import time

import pytest

from simulators.bench.bench import Setup, SimulatedBench

ascii_ = pytest.importorskip("zaber_motion.ascii", reason="zaber-motion is not installed (extra `peers`)")
from zaber_motion.exceptions import BadDataException, CommandFailedException  # noqa: E402


@pytest.fixture
def chain(tmp_path):
    bench = SimulatedBench(tmp_path, Setup(develop=lambda opening: b"raw", speed=20.0))
    host, port = bench.open_ports(("head",))["head"][1].removeprefix("socket://").split(":")
    connection = ascii_.Connection.open_tcp(host, int(port))
    connection.enable_alerts()
    yield connection
    connection.close()
    bench.close()


@pytest.fixture
def axis(chain):
    return chain.get_device(1).get_axis(1)


def test_both_devices_of_the_chain_are_found(chain):
    assert [device.device_address for device in chain.detect_devices(identify_devices=False)] == [1, 2]


def test_it_warns_until_it_is_homed(axis):
    assert "WR" in axis.warnings.get_flags()
    with pytest.raises(BadDataException):
        axis.generic_command("move abs 1000")
    axis.home()
    assert axis.get_position() == 0
    assert "WR" not in axis.warnings.get_flags()


def test_it_moves_and_stops(axis):
    axis.home()
    axis.move_absolute(20000)
    axis.move_relative(-500)
    assert axis.get_position() == 19500
    axis.generic_command("move abs 250000 1000 10")  # which would take minutes
    while axis.get_position() == 19500:
        assert axis.is_busy()
    axis.stop()
    assert not axis.is_busy()
    assert 19500 < axis.get_position() < 250000


def test_it_refuses_to_leave_its_travel(axis):
    axis.home()
    with pytest.raises(BadDataException):
        axis.move_absolute(99_999_999)
    assert axis.get_position() == 0


def test_it_says_that_it_has_no_inputs_and_outputs(chain):
    reported = chain.get_device(1).io.get_channels_info()
    assert reported.number_analog_outputs == reported.number_digital_outputs == 0


def test_a_parked_axis_keeps_its_place_over_a_reset_and_refuses_to_move(chain, axis):
    axis.home()
    axis.move_absolute(12000)
    axis.park()
    assert axis.is_parked()
    with pytest.raises(CommandFailedException, match="PARKED"):
        axis.generic_command("move abs 1000")
    chain.get_device(1).generic_command("system reset")
    assert axis.is_homed()
    assert axis.get_position() == 12000


def test_a_reset_loses_the_reference(chain, axis):
    axis.home()
    assert axis.is_homed()
    chain.get_device(1).generic_command("system reset")
    assert not axis.is_homed()
    with pytest.raises(BadDataException):
        axis.generic_command("move abs 1000")


def test_a_driver_that_is_off_moves_nothing(axis):
    axis.home()
    axis.driver_disable()
    assert "FO" in axis.warnings.get_flags()
    with pytest.raises(CommandFailedException, match="DRIVERDISABLED"):
        axis.generic_command("move abs 1000")
    axis.driver_enable()
    axis.move_absolute(1000)
    assert axis.get_position() == 1000


def test_one_move_has_a_speed_of_its_own(axis):
    axis.home()
    own = axis.settings.get("maxspeed")
    axis.generic_command("move abs 20000 1000 10")
    begin_s = time.monotonic()
    axis.wait_until_idle()
    # 20000 steps at 1000 / 1.6384 a second last 33 s, at twenty times the speed 1.6 s
    assert time.monotonic() - begin_s > 1.5
    assert axis.settings.get("maxspeed") == own
    assert axis.get_position() == 20000
