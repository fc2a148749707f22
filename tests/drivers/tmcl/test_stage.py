"""What TMCL modules do, and what the driver makes of it."""

import sys

import pytest

from drivers.errors import BadConfiguration, EmergencyStopped, MoveFailed, NoAnswer, WasReset
from drivers.tmcl.link import library
from drivers.tmcl.stage import TmclAxis

from .orders import AXES, MST, MVP, STEP, datagram, orders, restart

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
    homed.move_to(z_mm=3.0)
    assert bench.clock.now_s() - begin_s == pytest.approx(3.0 / 1.4305, abs=0.2)


def test_a_module_without_dividers_reports_microsteps_a_second(make, module):
    for motor in module.motors.values():
        del motor.settings[153], motor.settings[154]
    stage = make()
    stage.connect()
    assert stage.envelopes["z_mm"].speed == 1500.0


@pytest.mark.parametrize(
    ("number", "value", "words"),
    [(7, 0, "z_mm releases its motor"), (12, 1, "does not stop z_mm"), (13, 1, "does not stop z_mm")],
)
def test_what_makes_a_position_doubtful_is_reported(homed, module, number, value, words):
    assert homed.condition().caveat is None
    module.motors[0].settings[number] = value
    homed.connect()
    homed.home()
    assert words in homed.condition().caveat.reason


# --- stops between orders


def test_after_an_emergency_stop_the_other_axis_is_not_sent(homed, module, after_an_order, bench):
    module.obeyed.clear()
    after_an_order(MVP, 0, lambda: homed.trust.preempt(EmergencyStopped("emergency stop", "home the stage")))
    with pytest.raises(EmergencyStopped):
        homed.move_to(z_mm=10.0, x_mm=10.0)
    assert orders(module, MVP) == [0]
    assert not homed.moving()
    assert homed.position()["x_mm"] == pytest.approx(100.0)


def test_an_emergency_stop_ends_a_search_that_a_stop_of_the_motor_does_not(homed, bench, module):
    def emergency():
        bench.clock.sleep(0.3)
        bench.cables["stage"].happen(lambda now_s: module.receive(datagram(1, MST), now_s))
        assert module.motors[0].homing
        homed.emergency_stop()
        assert not any(motor.homing for motor in module.motors.values())

    ended, done = bench.clock.together(homed.home, emergency)
    assert isinstance(ended, EmergencyStopped)
    assert done is None


def test_a_move_that_was_not_answered_is_stopped(homed, bench, module, monkeypatch):
    obey = module._obey

    def deaf(command, *order):
        done = obey(command, *order)
        if command == MVP:
            module._out.clear()
            monkeypatch.setattr(module, "_send", lambda *answer: monkeypatch.undo())
        return done

    monkeypatch.setattr(module, "_obey", deaf)
    with pytest.raises(NoAnswer):
        homed.move_to(z_mm=10.0)
    bench.clock.sleep(0.1)  # it slows down in 0.03 s
    assert not homed.moving()
    assert 10.0 < homed.position()["z_mm"] <= 100.0


def test_an_axis_that_homed_to_a_place_outside_its_travel_is_stopped_before_that_is_reported(make, bench, monkeypatch):
    stage = make([TmclAxis("z_mm", 0, (-200.0, -100.0), STEP)])
    stage.connect()
    # as if it had said too early that it is done
    monkeypatch.setattr(stage, "_rest", lambda axes, limit_s: {axis: stage._state(axis) for axis in axes})
    with pytest.raises(MoveFailed, match=r"after homing, outside its travel -200 \.\. -100"):
        stage.home()
    bench.clock.sleep(0.1)
    assert not stage.moving()


# --- power cut and back


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


def test_no_position_is_reported_after_a_power_cycle(homed, bench, module):
    restart(bench, module)
    with pytest.raises(WasReset):
        homed.position()
    assert not homed.condition().usable
    assert homed.position()["z_mm"] == 0.0  # what the module says, of a stage that is not homed


def test_a_module_that_keeps_no_variables_is_flagged(make, module):
    stage = make(variable=200)
    stage.connect()
    stage.home()
    assert "does not report that it was switched off" in stage.condition().caveat.reason
    stage.move_to(z_mm=10.0)


# --- a stop where nobody answers
