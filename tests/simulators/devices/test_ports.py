"""The twins as other programs meet them: through pseudo-terminals and TCP, in real time."""

import os

import pytest

from drivers.errors import LineLost, NoAnswer
from drivers.protocols.zaber import ZaberParser
from drivers.rangefinder import JrtParser, JrtRangefinder
from drivers.shutter import StrigParser, StrigShutter
from drivers.transport import SerialTransport
from drivers.zaber import ZaberAxis, ZaberStage
from simulators.bench.bench import Setup, SimulatedBench

pytestmark = pytest.mark.skipif(os.name != "posix", reason="no pseudo-terminals here")


@pytest.fixture
def ports(tmp_path):
    bench = SimulatedBench(tmp_path, Setup(develop=lambda opening: b"raw", speed=20.0))
    yield bench.open_ports(("shutter", "head", "rangefinder"))
    bench.close()


@pytest.mark.parametrize("which", [0, 1])
def test_a_shutter_answers_on_both(ports, which):
    shutter = StrigShutter(SerialTransport(ports["shutter"][which], StrigParser))
    try:
        assert shutter.connect().model == "STRIG/4 simulated"
    finally:
        shutter.close()


def test_a_chain_is_homed_over_tcp(ports):
    axes = [ZaberAxis("pan_deg", 1, 0.000234375, zero=-30.0)]
    head = ZaberStage(SerialTransport(ports["head"][1], ZaberParser), axes, poll_s=0.01)
    try:
        head.connect()
        head.home()
        head.move_to(pan_deg=5.0)
        assert head.position()["pan_deg"] == pytest.approx(5.0, abs=0.001)
    finally:
        head.close()


def test_one_program_at_a_time(ports):
    first = JrtRangefinder(SerialTransport(ports["rangefinder"][0], JrtParser, baud=19200))
    second = JrtRangefinder(SerialTransport(ports["rangefinder"][1], JrtParser, baud=19200))
    try:
        first.connect()
        with pytest.raises((LineLost, NoAnswer)):
            second.connect()
        first.measure()
    finally:
        first.close()
        second.close()
