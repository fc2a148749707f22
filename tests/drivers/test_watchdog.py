"""The watchdog at its twin: heartbeats keep the motors enabled, and without them every axis has lost its position."""

import threading
from types import SimpleNamespace

import pytest

from drivers.errors import BadConfiguration, LineLost, MoveFailed, NotHomed
from drivers.grbl import GrblStage
from drivers.protocols.grbl import GrblAxis, GrblParser
from drivers.shutter import StrigParser, StrigShutter
from drivers.transport import SerialTransport
from drivers.watchdog import StrigWatchdog, WatchdogOptions
from simulators.bench.bench import Setup, SimulatedBench

AXES = [GrblAxis("z_mm", "X", 3000.0), GrblAxis("x_mm", "Y", 1500.0), GrblAxis("y_mm", "Z", 1500.0)]
LOST = "released the motors: no heartbeat of this program came in time"


class Lab:
    """A rail and a box whose output enables its motors, in a time that waits for every heartbeat."""

    def __init__(self, folder):
        setup = Setup(develop=lambda opening: b"", virtual_time=True, motors_on_box=True)
        self.bench = SimulatedBench(folder, setup)
        self.clock, self.twin = self.bench.clock, self.bench.devices["shutter"]
        self.enabled, enable = [], self.twin.enable
        self.twin.enable = lambda on, now_s: (self.enabled.append((on, now_s)), enable(on, now_s))
        self.stage = GrblStage(self._wire("stage", GrblParser), AXES, clock=self.clock)
        self.box = StrigShutter(self._wire("shutter", StrigParser), clock=self.clock)
        self.watchdog = StrigWatchdog(self.box, [self.stage], begin=self.begin)
        for device in (self.stage, self.box, self.watchdog):
            device.connect()
        self.enabled.clear()

    def _wire(self, name, parser):
        return SerialTransport(self.bench.address(name), parser, clock=self.clock)

    def begin(self, work):
        """In a thread of this time."""
        begun = threading.Event()
        thread = threading.Thread(target=self.clock.together, args=(lambda: (begun.set(), work()),), daemon=True)
        thread.start()
        begun.wait()
        return thread

    def suspend(self):
        """No heartbeat is sent any more."""
        self.box.beat = lambda next_ms: None

    def resume(self):
        del self.box.beat

    @property
    def releases(self):
        """When the motors were released, since there were enabled first."""
        return [at_s for on, at_s in self.enabled if not on]

    def close(self):
        self.watchdog.close()
        self.box.close()
        self.stage.close()
        self.bench.close()


@pytest.fixture
def lab(tmp_path):
    lab = Lab(tmp_path)
    yield lab
    lab.close()


def test_the_motors_are_enabled_by_homing_and_released_by_closing(lab):
    assert lab.watchdog.condition().word == "motors released"
    lab.stage.home()
    assert lab.watchdog.condition().word == "motors enabled"
    lab.stage.move_to(z_mm=400.0)
    lab.clock.sleep(60.0)
    lab.box.fire(0.1)
    assert lab.bench.world.axes["z_mm"].position(lab.clock.now_s()) == pytest.approx(400.0, abs=0.01)
    assert [on for on, _ in lab.enabled] == [True]
    lab.watchdog.close()
    assert [on for on, _ in lab.enabled] == [True, False]
    with pytest.raises(NotHomed, match=r"released by closing the watchdog .* home the stage"):
        lab.stage.move_to(z_mm=0.0)


def test_heartbeats_state_the_deadlines_of_the_protocol(lab, monkeypatch):
    beat, stated = lab.box.beat, set()
    monkeypatch.setattr(lab.box, "beat", lambda ms: (stated.add(ms), beat(ms)))
    lab.stage.home()
    lab.clock.sleep(1.0)
    assert stated == {100, 1000}  # firmware/STRIG.md
    parts = SimpleNamespace(other={"shutter": lab.box, "rail": lab.stage}.get)
    made = WatchdogOptions(box="shutter", stages=("rail",)).make(parts)
    assert (made.address, lab.stage.power) == (lab.box.address, made.power)


def test_an_axis_that_moves_stops_100_ms_after_the_last_heartbeat(lab):
    lab.stage.home()
    axis, clock = lab.bench.world.axes["z_mm"], lab.clock

    def suspend():
        clock.sleep(1.0)
        lab.suspend()
        suspended_s = clock.now_s()
        clock.sleep(0.3)
        return suspended_s

    moved, suspended_s = clock.together(lambda: lab.stage.move_to(z_mm=0.0), suspend)
    # the last heartbeat came up to 25 ms before
    assert len(lab.releases) == 1
    assert 0.075 - 1e-6 <= lab.releases[0] - suspended_s <= 0.1 + 1e-6
    assert axis.velocity(lab.releases[0] - 1e-3) != 0.0
    assert not axis.moves(lab.releases[0])
    assert isinstance(moved, NotHomed)
    assert LOST in moved.reason


def test_after_a_release_the_stage_reports_it_until_it_has_homed_again(lab):
    lab.stage.home()
    lab.suspend()
    lab.clock.sleep(5.0)
    refused = lab.stage.condition()
    assert not refused.usable
    assert LOST in refused.word
    assert refused.remedy == "home the stage"
    with pytest.raises(NotHomed, match=LOST):
        lab.stage.move_to(z_mm=0.0)
    lab.resume()
    lab.clock.sleep(5.0)
    assert [on for on, _ in lab.enabled] == [True, False]  # a heartbeat alone enables nothing
    lab.stage.home()
    lab.stage.move_to(z_mm=10.0)
    assert [on for on, _ in lab.enabled] == [True, False, True]


def test_axes_that_stand_may_miss_heartbeats_for_a_second(lab):
    lab.stage.home()
    lab.clock.sleep(1.0)
    lab.suspend()
    lab.clock.sleep(0.9)
    assert not lab.releases
    lab.clock.sleep(0.2)
    assert len(lab.releases) == 1


def test_a_host_that_goes_on_before_its_release_was_reported_is_reported_again(lab):
    lab.stage.home()
    faults = lab.bench.cables["shutter"].faults
    faults.spoil_reply = lambda data, at_s: b"" if b"RELEASE" in data else data
    lab.suspend()
    lab.clock.sleep(2.0)
    assert lab.stage.condition().usable
    del faults.spoil_reply
    lab.resume()
    lab.clock.sleep(0.1)
    assert LOST in lab.stage.condition().word


def test_a_box_that_restarts_has_released_the_motors(lab):
    lab.stage.home()
    lab.bench.cables["shutter"].happen(lab.twin.restart)
    lab.clock.sleep(2.0)
    assert LOST in lab.stage.condition().word


def test_a_box_that_is_unplugged_has_released_the_motors(lab):
    lab.stage.home()
    lab.box.close()
    lab.clock.sleep(2.0)
    assert "released the motors: " in lab.stage.condition().word
    assert len(lab.releases) == 1
    with pytest.raises(LineLost, match=r"the shutter box at .* is not connected; connect the shutter first"):
        lab.stage.home()


def test_an_emergency_stop_leaves_the_motors_enabled(lab):
    lab.stage.home()
    for device in (lab.stage, lab.box, lab.watchdog):
        device.emergency_stop()
    lab.clock.sleep(5.0)
    assert not lab.releases


def test_heartbeats_are_left_out_of_the_transcript(lab):
    lab.stage.home()
    lab.clock.sleep(1.0)
    sent = [one.data for one in lab.box._transport.transcript.last() if one.way == ">"]
    assert b"ENABLE 1\n" in sent
    assert not [data for data in sent if b"BEAT" in data]


def test_an_axis_without_current_stays_where_it_is(lab):
    lab.stage.home()
    lab.bench.world.axes["z_mm"].power(False, lab.clock.now_s())
    with pytest.raises(MoveFailed, match="z_mm stopped at"):
        lab.stage.move_to(z_mm=0.0)


def test_a_box_of_an_earlier_version_has_none(lab):
    lab.box.version = 2
    with pytest.raises(BadConfiguration, match=r"speaks STRIG/2, which has no watchdog; load the firmware"):
        lab.watchdog.connect()
