"""What TMCL modules do, and what the driver makes of it."""

from __future__ import annotations

import struct
import sys

import pytest

from drivers.errors import BadConfiguration, EmergencyStopped, MoveFailed, NoAnswer, NotHomed, Rejected, WasReset
from drivers.protocols.tmcl import TmclParser, checksum
from drivers.transport import SerialTransport
from simulators.devices.serial_device import Cable, plug
from simulators.devices.tmcl import TmclModule
from simulators.world.motion import Axis

pytest.importorskip("pytrinamic", reason="pytrinamic is not installed (extra `tmcl`)")
from drivers.tmcl.link import library, stop_bytes
from drivers.tmcl.stage import TmclAxis, TmclStage

STEP = 1 / 320
AXES = [TmclAxis("z_mm", 0, (0.0, 200.0), STEP), TmclAxis("x_mm", 1, (0.0, 200.0), STEP)]
MVP, MST, RFS = 4, 3, 13


@pytest.fixture
def module(bench):
    module = TmclModule([(Axis(0.0, 200.0, 20.0), STEP) for _ in AXES])
    bench.cables["stage"] = cable = Cable(module, bench.clock)
    plug(f"{bench.name}/stage", cable)
    return module


@pytest.fixture
def make(bench, module):
    made = []

    def make(axes=AXES, **told):
        wire = SerialTransport(bench.address("stage"), TmclParser, baud=9600, clock=bench.clock)
        made.append(TmclStage(wire, axes, clock=bench.clock, **told))
        return made[-1]

    yield make
    for stage in made:
        stage.close()


@pytest.fixture
def stage(make):
    stage = make()
    stage.connect()
    return stage


@pytest.fixture
def homed(stage):
    stage.home()
    stage.move_to(z_mm=100.0, x_mm=100.0)
    return stage


@pytest.fixture
def after_an_order(module, monkeypatch):
    """Let something happen as soon as the module has obeyed its first order of a kind."""

    def when(command, kind, happen):
        obey = module._obey

        def meddled(*order):
            done = obey(*order)
            if order[:2] == (command, kind):
                monkeypatch.setattr(module, "_obey", obey)
                happen()
            return done

        monkeypatch.setattr(module, "_obey", meddled)

    return when


def orders(module, command, kind=None):
    """The motors that were given such an order."""
    return [number for said, type_, number, _ in module.obeyed if said == command and kind in (None, type_)]


def datagram(module, command, kind=0, motor=0, value=0):
    body = struct.pack(">BBBBi", module, command, kind, motor, value)
    return body + bytes([checksum(body)])


# --- who is there


def test_it_says_model_and_version(make):
    identity = make().connect()
    assert (identity.model, identity.firmware) == ("TMCL TMCM-3110", "1.15")


def test_every_missing_module_of_the_line_is_named(make):
    strangers = [TmclAxis(f"{module}_mm", 0, (0.0, 10.0), STEP, module=module) for module in (5, 7)]
    with pytest.raises(NoAnswer, match="no answer from modules 5, 7; check power"):
        make([*AXES, *strangers]).connect()


def test_a_motor_that_is_not_there_is_named(make):
    with pytest.raises(BadConfiguration, match="y_mm is set to no speed"):
        make([TmclAxis("y_mm", 4, (0.0, 10.0), STEP)]).connect()


def test_without_the_library_it_says_what_to_install(make, monkeypatch):
    library.cache_clear()
    monkeypatch.setitem(sys.modules, "pytrinamic.tmcl", None)
    with pytest.raises(BadConfiguration, match=r"pip install 'calibration-station\[tmcl\]'"):
        make().connect()


def test_a_move_is_awaited_at_the_modules_own_pace(homed, module, bench):
    # 16 MHz * 1500 / 2^(3 + 16) microsteps of 1/320 mm a second; a hundredth of it needs a hundred times as long
    assert homed.envelopes["z_mm"].speed * STEP == pytest.approx(143.05, abs=0.01)
    homed.move_to(z_mm=1.0, x_mm=0.0)
    module.motors[0].settings[4] = 15
    homed.connect()
    homed.home()
    begin_s = bench.clock.now_s()
    homed.move_to(z_mm=5.0)
    assert bench.clock.now_s() - begin_s == pytest.approx(5.0 / 1.4305, abs=0.2)


def test_a_module_without_dividers_tells_microsteps_a_second(make, module):
    for motor in module.motors:
        del motor.settings[153], motor.settings[154]
    stage = make()
    stage.connect()
    assert stage.envelopes["z_mm"].speed == 1500.0


@pytest.mark.parametrize(
    ("number", "value", "words"),
    [(7, 0, "z_mm lets go of its motor"), (12, 1, "does not stop z_mm"), (13, 1, "does not stop z_mm")],
)
def test_what_makes_a_position_doubtful_is_said(homed, module, number, value, words):
    assert homed.condition().doubt is None
    module.motors[0].settings[number] = value
    homed.connect()
    homed.home()
    assert words in homed.condition().doubt.reason


# --- stops between orders


def test_after_a_stop_the_other_axis_is_not_sent(homed, module, after_an_order):
    module.obeyed.clear()
    after_an_order(MVP, 0, homed._one_mover.stop)
    with pytest.raises(MoveFailed, match="stopped before all axes"):
        homed.move_to(z_mm=10.0, x_mm=10.0)
    assert orders(module, MVP) == [0]
    assert not homed.moving()


def test_after_an_emergency_stop_the_other_axis_is_not_sent(homed, module, after_an_order, bench):
    module.obeyed.clear()
    after_an_order(MVP, 0, lambda: homed.trust.shout(EmergencyStopped("emergency stop", "home the stage")))
    with pytest.raises(EmergencyStopped):
        homed.move_to(z_mm=10.0, x_mm=10.0)
    assert orders(module, MVP) == [0]
    assert not homed.moving()
    assert homed.position()["x_mm"] == pytest.approx(100.0)


def test_after_a_stop_the_other_axis_does_not_search(homed, module, after_an_order):
    module.obeyed.clear()
    after_an_order(RFS, 0, homed._one_mover.stop)
    with pytest.raises(MoveFailed, match="stopped before all axes"):
        homed.home()
    assert orders(module, RFS, 0) == [0]
    assert not homed.moving()
    assert not homed.condition().usable


def test_an_emergency_stop_ends_a_search_that_a_stop_of_the_motor_does_not(homed, bench, module):
    def emergency():
        bench.clock.sleep(0.3)
        bench.cables["stage"].happen(lambda now_s: module.receive(datagram(1, MST), now_s))
        assert module.motors[0].searching
        homed.emergency_stop()
        assert not any(motor.searching for motor in module.motors)

    ended, done = bench.clock.together(homed.home, emergency)
    assert isinstance(ended, EmergencyStopped)
    assert done is None


def test_a_move_that_was_not_answered_is_stopped(homed, bench, module, monkeypatch):
    obey = module._obey

    def deaf(command, *order):
        done = obey(command, *order)
        if command == MVP:
            module._out.clear()
            monkeypatch.setattr(module, "_say", lambda *told: monkeypatch.undo())
        return done

    monkeypatch.setattr(module, "_obey", deaf)
    with pytest.raises(NoAnswer):
        homed.move_to(z_mm=10.0)
    bench.clock.sleep(0.1)  # it slows down in 0.03 s
    assert not homed.moving()
    assert 10.0 < homed.position()["z_mm"] <= 100.0


# --- power cut and back


def restart(bench, module):
    bench.cables["stage"].happen(module.restart)


def test_a_power_cycle_in_mid_move_stops_the_other_axes_and_takes_the_trust(homed, bench, module):
    def cut():
        bench.clock.sleep(0.3)
        restart(bench, module)

    moved, _ = bench.clock.together(lambda: homed.move_to(z_mm=0.0, x_mm=200.0), cut)
    assert isinstance(moved, WasReset)
    assert "was switched off and on" in moved.reason
    with pytest.raises(WasReset, match="home the stage"):
        homed.move_to(z_mm=10.0)
    assert not homed.moving()
    homed.home()
    homed.move_to(z_mm=10.0)


def test_a_power_cycle_in_mid_search_is_no_homing(stage, bench, module):
    stage.home()
    stage.move_to(z_mm=150.0)

    def cut():
        bench.clock.sleep(0.3)
        restart(bench, module)

    homed, _ = bench.clock.together(stage.home, cut)
    assert isinstance(homed, WasReset)
    assert not stage.condition().usable


def test_a_power_cycle_between_two_moves_is_noticed_before_anything_moves(homed, bench, module):
    restart(bench, module)
    module.obeyed.clear()
    with pytest.raises(WasReset):
        homed.move_to(z_mm=10.0)
    assert orders(module, MVP) == []


def test_a_power_cycle_between_the_orders_of_a_move_is_noticed_before_the_next_one(
    homed, bench, module, after_an_order
):
    module.obeyed.clear()
    after_an_order(MVP, 0, lambda: module.restart(bench.clock.now_s()))
    with pytest.raises(WasReset):
        homed.move_to(z_mm=10.0, x_mm=10.0)
    assert orders(module, MVP) == [0]
    assert not homed.moving()


def test_no_position_is_told_after_a_power_cycle(homed, bench, module):
    restart(bench, module)
    with pytest.raises(WasReset):
        homed.position()
    assert not homed.condition().usable
    assert homed.position()["z_mm"] == 0.0  # what the module says, of a stage that is not homed


def test_a_module_that_keeps_no_variables_is_doubted(make, module):
    stage = make(variable=200)
    stage.connect()
    stage.home()
    assert "does not tell when it was switched off" in stage.condition().doubt.reason
    stage.move_to(z_mm=10.0)


# --- in step


def test_the_numbers_of_the_library_are_the_manuals():
    assert library().datagram(1, MVP, 0, 2, -1000) == datagram(1, MVP, 0, 2, -1000)
    with pytest.raises(Rejected, match=r"module 1 at here refused MVP 9, 0, 5: status 3 \(wrong type\)"):
        library().host(lambda sent: _answer(3, sent[1], 0), "here").move(9, 0, 5, 1)


def _answer(status, command, value):
    body = struct.pack(">BBBBi", 2, 1, status, command, value)
    return body + bytes([checksum(body)])


@pytest.mark.parametrize("stray", range(1, 9))
def test_a_module_that_has_stray_bytes_is_brought_into_step(homed, bench, module, stray):
    bench.cables["stage"].happen(lambda now_s: module.receive(bytes(stray), now_s))
    assert homed.position()["z_mm"] == pytest.approx(100.0)
    homed.move_to(z_mm=20.0)


def test_an_answer_that_comes_late_is_not_taken_for_the_next_ones(homed, bench):
    bench.cables["stage"].faults.delay_s = 0.32  # past the deadline of a question, before that of the next
    with pytest.raises(NoAnswer):
        homed._link.host().get_axis_parameter(1, 0, 1, signed=True)
    bench.cables["stage"].faults.delay_s = 0.0
    assert homed._parameter(AXES[0], 3) == 0  # its speed, and not its position


def rest(cut, module_number=1):
    """Two motors on their way; one gets `cut` bytes of an order, then the stop."""
    axes = [Axis(0.0, 1e9, 5e8), Axis(0.0, 1e9, 5e8)]
    module = TmclModule([(axis, 1.0) for axis in axes], address=module_number)
    module.receive(datagram(module_number, 1, 0, 0, 500) + datagram(module_number, 2, 0, 1, 500), 0.0)
    assert all(axis.velocity(1.0) for axis in axes)
    module.obeyed.clear()
    module.receive(datagram(module_number, MVP, 0, 0, 123456)[:cut], 1.0)
    module.receive(stop_bytes([(module_number, 0), (module_number, 1)]), 1.0)
    return module, axes


@pytest.mark.parametrize("cut", range(9))
def test_the_stop_reaches_a_module_wherever_it_is_in_a_datagram(cut):
    module, axes = rest(cut)
    assert {order[0] for order in module.obeyed} == {MST, RFS}
    module.advance(1000.0)
    assert [axis.velocity(1000.0) for axis in axes] == [0.0, 0.0]


@pytest.mark.slow
def test_nothing_of_the_stop_is_another_order_however_it_is_read():
    for address in range(1, 256):
        stops = stop_bytes([(address, motor) for motor in range(6)])
        for shift in range(9):
            for at in range(shift, len(stops) - 8, 9):
                read = stops[at : at + 9]
                if read[0] == address and checksum(read[:-1]) == read[-1]:
                    assert read[1:3] in (bytes([MST, 0]), bytes([RFS, 1]))


def test_a_stop_leaves_a_module_in_step_where_it_was():
    module, _ = rest(0)
    module.advance(1.0)
    module.receive(datagram(1, 136, 1), 1.0)
    assert module.advance(1.0) == _answer(100, 136, 3110 << 16 | 1 << 8 | 15)


def test_a_stage_that_was_not_connected_takes_a_stop(make):
    stage = make()
    stage.emergency_stop()
    stage.connect()
    with pytest.raises(NotHomed):
        stage.move_to(z_mm=1.0)
