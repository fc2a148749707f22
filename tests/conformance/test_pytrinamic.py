"""The TMCL twin on a pseudo-terminal, driven by the maker's own library: its line, its datagrams, its module."""

import time

import pytest

from simulators.devices.ports import PtyPort
from simulators.devices.serial_device import Cable
from simulators.devices.tmcl import TmclModule
from simulators.world.clock import FastClock
from simulators.world.motion import Axis

REASON = "pytrinamic is not installed (extra `tmcl`)"
connections = pytest.importorskip("pytrinamic.connections.serial_tmcl_interface", reason=REASON)
from pytrinamic.modules.TMCM3110 import TMCM3110  # noqa: E402
from pytrinamic.tmcl import TMCLReplyStatusError  # noqa: E402

PATIENCE_S = 30.0
"""Longer than anything here takes, on any machine."""
SLOW = 1
"""0.1 mm/s, 5 mm/s of the test's time: no end is reached while it looks."""


@pytest.fixture
def twin():
    return TmclModule([(Axis(0.0, 300.0, 150.0), 1 / 320) for _ in range(3)])


@pytest.fixture
def line(twin):
    port = PtyPort(Cable(twin, FastClock(50.0)))
    with connections.SerialTmclInterface(port.address, 9600) as line:
        yield line
    port.close()


@pytest.fixture
def module(line):
    return TMCM3110(line)


def until(happened):
    deadline_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline_s


@pytest.fixture
def homed(module):
    module.start_reference_search(0)
    until(lambda: module.get_reference_search_status(0) == 0)
    return module


def test_it_says_who_it_is(line):
    assert line.get_version_string() == "3110V115"
    assert line.send(136, 1, 0, 0).value == 3110 << 16 | 1 << 8 | 15


def test_what_it_has_not_is_refused_by_name(line):
    with pytest.raises(TMCLReplyStatusError) as refused:
        line.send(99, 0, 0, 0)
    assert refused.value.error_description == "Invalid Command"
    with pytest.raises(TMCLReplyStatusError) as refused:
        line.get_axis_parameter(250, 0)
    assert refused.value.error_description == "Wrong Type"
    with pytest.raises(TMCLReplyStatusError) as refused:
        line.move_to(7, 0)
    assert refused.value.error_description == "Invalid Value"


def test_it_searches_its_reference_moves_and_says_where_it_is(homed, twin):
    motor = homed.motors[0]
    assert motor.actual_position == 0
    homed.move_to(0, 32_000)
    until(motor.get_position_reached)
    assert motor.actual_position == 32_000
    assert twin.motors[0].axis.position(1e9) == pytest.approx(100.0)
    homed.move_by(0, -1_600)
    until(motor.get_position_reached)
    assert motor.actual_position == 30_400
    assert motor.target_position == 30_400


def test_it_turns_until_it_is_stopped(homed):
    motor = homed.motors[0]
    motor.linear_ramp.max_velocity = SLOW
    homed.rotate(0, SLOW)
    until(lambda: motor.actual_position > 0)  # it has a velocity before it has gone a microstep
    homed.stop(0)
    until(lambda: motor.actual_velocity == 0)
    rest = motor.actual_position
    assert 0 < rest <= 96_000
    assert motor.actual_position == rest


def test_a_search_is_ended(module):
    module.motors[0].linear_ramp.max_velocity = SLOW
    module.start_reference_search(0)
    module.stop(0)
    assert module.get_reference_search_status(0) != 0  # a stop of the motor does not end it
    module.stop_reference_search(0)
    assert module.get_reference_search_status(0) == 0


def test_settings_are_read_and_set(module):
    ramp = module.motors[0].linear_ramp
    assert ramp.max_velocity == 1500
    ramp.max_velocity = 700
    assert ramp.max_velocity == 700
    module.set_global_parameter(55, 2, 123456789)
    assert module.get_global_parameter(55, 2) == 123456789
