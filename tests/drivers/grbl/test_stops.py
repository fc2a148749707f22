"""What ends a move of GRBL or a homing, and what is left then."""

import pytest

from drivers.errors import Alarm, EmergencyStopped, Held, MoveFailed, NoAnswer, NotHomed, WasReset
from drivers.protocols.grbl import GrblAxis


def test_a_feed_hold_at_the_controller_ends_the_move_in_an_error(homed, bench):
    # GRBL cancels a jog on any hold
    def hold():
        bench.clock.sleep(1.0)
        homed.link.write(b"!")

    moved, _ = bench.clock.together(lambda: homed.move_to(z_mm=100.0), hold)
    assert isinstance(moved, MoveFailed)
    assert homed.condition().usable


def test_a_reset_in_mid_run_takes_the_trust(homed, bench, twin):
    def reset():
        bench.clock.sleep(1.0)
        bench.cables["stage"].happen(twin.restart)

    moved, _ = bench.clock.together(lambda: homed.move_to(z_mm=100.0), reset)
    assert isinstance(moved, WasReset)
    with pytest.raises(WasReset, match="restarted; home the stage"):
        homed.move_to(z_mm=100.0)


def test_a_power_failure_whose_greeting_was_lost_takes_the_trust(homed, bench, twin):
    cable, now_s = bench.cables["stage"], bench.clock.now_s()
    cable.faults.silent = ((now_s, now_s + 2.0),)
    cable.happen(twin.restart)
    bench.clock.sleep(3.0)
    with pytest.raises(NotHomed, match="is locked; home the stage"):
        homed.move_to(z_mm=100.0)
    assert not homed.condition().usable
    homed.home()
    homed.move_to(z_mm=100.0)


@pytest.mark.parametrize(("code", "word"), [(1, "hard limit"), (3, "reset while moving"), (17, "motor driver")])
def test_an_alarm_is_named_and_homing_recovers_from_it(homed, bench, twin, code, word):
    bench.cables["stage"].happen(lambda now_s: twin.alarm(code, now_s))
    bench.clock.sleep(0.1)
    with pytest.raises(Alarm, match=word):
        homed.move_to(z_mm=100.0)
    homed.home()
    homed.move_to(z_mm=100.0)


def test_a_move_beyond_its_time_is_stopped(homed, twin):
    twin.settings[110] = 60.0  # fifty times slower than the driver assumes
    limit_s = 2 * homed.pace({"z_mm": 499.0})[1] + 2  # from 1499 mm
    with pytest.raises(NoAnswer, match=f"still moves after {limit_s:.1f} s"):
        homed.move_to(z_mm=1000.0)
    assert not homed.moving()


def test_homing_has_the_time_of_every_axis_the_firmware_has(make, twin):
    # the longest axis is not configured, and needs more than twice the time of the one that is
    twin.settings[25] = 500.0
    stage = make([GrblAxis("y_mm", "Z", 1500.0)])
    stage.connect()
    stage.home()
    assert stage.condition().usable


def deaf(twin):
    """A controller that homes and says no word any more."""
    say, twin._send = twin._send, lambda *lines: None
    return lambda: setattr(twin, "_send", say)


def test_homing_that_ends_without_an_answer_is_reset(make, bench, twin, monkeypatch):
    stage, speaks = make(), []
    stage.connect()
    twin.settings[25] = 1.0  # it searches for hours
    command = stage.link.command

    def then_deaf(words, *given):
        speaks.append(deaf(twin))
        return command(words, *given)

    with monkeypatch.context() as patched:
        patched.setattr(stage, "_homing_limit_s", lambda: 1.0)
        patched.setattr(stage.link, "command", then_deaf)
        with pytest.raises(NoAnswer):
            stage.home()
    assert not bench.world.axes["z_mm"].moves(bench.clock.now_s())
    assert stage.condition().word.startswith("homing was given up")
    assert (stage.condition().usable, stage.condition().remedy) == (False, "home the stage")
    speaks[0]()
    twin.settings[25] = 3000.0
    stage.home()
    assert stage.condition().usable


def test_stop_stops_a_homing_that_nobody_waits_for(make, bench, twin):
    stage = make()
    stage.connect()
    twin.settings[25] = 1.0
    stage.link.write(b"$H\n")
    bench.clock.sleep(0.5)
    assert bench.world.axes["z_mm"].moves(bench.clock.now_s())
    stage.stop()
    assert not bench.world.axes["z_mm"].moves(bench.clock.now_s())


def test_an_exception_that_ends_the_program_stops_a_move(homed, bench, monkeypatch):
    def interrupted(duration_s, over):
        raise KeyboardInterrupt

    monkeypatch.setattr(homed.link, "pause", interrupted)
    with pytest.raises(KeyboardInterrupt):
        homed.move_to(z_mm=100.0)
    assert not bench.world.axes["z_mm"].moves(bench.clock.now_s())


def test_no_order_follows_an_emergency_stop_that_came_between(homed, twin):
    # between the question where it is and the order to go elsewhere
    ask = homed.link.settled_report

    def stopped_meanwhile():
        report = ask()
        homed.emergency_stop()
        return report

    homed.link.settled_report = stopped_meanwhile
    with pytest.raises(EmergencyStopped):
        homed.move_to(z_mm=100.0)
    assert not any(b"$J" in p.data for p in homed.link._transport.transcript.last())


def test_motors_that_let_go_between_moves_are_flagged(make, twin):
    stage = make()
    stage.connect()
    assert stage.condition().caveat is None
    twin.settings[1] = 25
    stage.connect()
    caveat = stage.condition().caveat
    assert "let go 25 ms after each move" in caveat.reason
    assert "set $1=255" in caveat.remedy


def opened_in_mid_move(homed, bench, twin):
    """The end of a move, during which the door is opened."""

    def open_the_door():
        bench.clock.sleep(1.0)
        bench.cables["stage"].happen(lambda now_s: twin.door(True, now_s))

    moved, _ = bench.clock.together(lambda: homed.move_to(z_mm=100.0), open_the_door)
    return moved


def test_a_door_is_named_and_the_move_goes_on_from_where_it_stood(homed, bench, twin):
    assert isinstance(opened_in_mid_move(homed, bench, twin), Held)
    bench.clock.sleep(1.0)
    with pytest.raises(Held, match="is paused at the door; close it and resume"):
        homed.move_to(z_mm=100.0)
    assert not homed.moving()
    with pytest.raises(Held, match="is paused at the door"):
        homed.resume()
    bench.cables["stage"].happen(lambda now_s: twin.door(False, now_s))
    with pytest.raises(Held, match="which is closed again; resume"):  # closing alone starts nothing
        homed.move_to(z_mm=100.0)
    assert "at the door" in homed.condition().word
    homed.resume()
    homed.move_to(z_mm=100.0)
    assert homed.position()["z_mm"] == pytest.approx(100.0)


def test_a_door_is_named_where_reports_report_of_a_jog_that_goes_on(homed, bench, twin):
    # grblHAL's simulator, 2026: neither hold nor cancelling ends it, and resuming makes it a program
    twin.program.variant = "grblHAL"
    moved = opened_in_mid_move(homed, bench, twin)
    assert isinstance(moved, Held)
    assert "at the door" in str(moved)
    assert not homed.condition().usable
    assert homed.condition().remedy == "close it, then home the stage"
    bench.cables["stage"].happen(lambda now_s: twin.door(False, now_s))
    homed.home()
    homed.move_to(z_mm=100.0)


def test_a_feed_hold_is_named(homed, bench):
    homed.link.write(b"!")
    with pytest.raises(Held, match="feed hold was pressed; resume"):
        homed.move_to(z_mm=100.0)
    homed.resume()
    homed.move_to(z_mm=100.0)


@pytest.mark.slow
def test_a_feed_override_is_named_and_waited_for(homed, twin, bench):
    twin.motion.overrides[0] = 40
    for _ in range(20):  # reported in some reports only
        homed.link._transport.write(b"?")
    bench.clock.sleep(0.1)
    assert "the feed override is 40 %" in homed.condition().word
    twin.settings[110] = 0.45 * 3000.0  # slower than half its feed: too slow without the override
    homed.move_to(z_mm=1000.0)
    twin.settings[110] = 60.0
    with pytest.raises(NoAnswer, match="the feed override is 40 %; set the override to 100 %"):
        homed.move_to(z_mm=100.0)


def test_grbl_is_reset_again_where_it_did_not_hear(homed, bench, twin):
    bench.cables["stage"].happen(lambda now_s: twin.alarm(1, now_s))
    homed.home()  # at once, while GRBL is deaf
    homed.move_to(z_mm=100.0)


def test_a_port_that_does_not_take_the_end_of_a_jog_gets_a_reset(homed):
    line = homed.link._transport
    line._outgoing._turn.acquire()  # somebody's order does not leave the port
    with pytest.raises(NoAnswer, match=r"took no bytes for 0\.03 s"):
        homed.stop()
    line._outgoing._turn.release()
    assert [one.data for one in line.transcript.last() if one.way == "!"] == [b"\x18"]
    assert not homed.condition().usable
