"""What GRBL does against its manual, and what the driver makes of it."""

from __future__ import annotations

import pytest

from drivers.errors import (
    Alarm,
    BadConfiguration,
    DeviceError,
    EmergencyStopped,
    Held,
    MoveFailed,
    NoAnswer,
    OutsideTravel,
    Rejected,
    WasReset,
)
from drivers.grbl import GrblStage
from drivers.grbl_envelope import GrblAxis
from drivers.interfaces import Travel
from drivers.light import GrblLight
from drivers.protocols.grbl import GrblParser
from drivers.transport import SerialTransport
from simulators.devices.grbl import GrblController
from simulators.devices.grbl_state import Outputs
from simulators.devices.serial_device import Cable, plug

AXES = [GrblAxis("z_mm", "X", 3000.0), GrblAxis("x_mm", "Y", 1500.0)]


@pytest.fixture
def twin(bench):
    return bench.devices["stage"]


@pytest.fixture
def make(bench):
    made = []

    def make(axes=AXES, **options):
        wire = SerialTransport(bench.address("stage"), GrblParser, clock=bench.clock)
        made.append(GrblStage(wire, axes, clock=bench.clock, **options))
        return made[-1]

    yield make
    for stage in made:
        stage.close()


@pytest.fixture
def homed(make):
    stage = make()
    stage.connect()
    stage.home()
    return stage


@pytest.mark.parametrize("variant", ["GRBL", "grblHAL", "FluidNC"])
def test_the_firmware_is_told_by_greeting_and_questions(make, twin, variant):
    twin.variant = variant
    axes = [GrblAxis("z_mm", "X", 3000.0, travel=1500.0)]
    assert make(axes).connect().model == variant


def test_the_size_of_its_buffer_is_read_not_assumed(make, twin):
    twin.rx_bytes = 1024
    stage = make()
    stage.connect()
    assert stage.link.rx_bytes == 1024


@pytest.mark.parametrize(("flag", "word"), [(20, "soft limits"), (22, "homing")])
def test_a_controller_without_limits_is_refused(make, twin, flag, word):
    twin.settings[flag] = 0
    with pytest.raises(BadConfiguration, match=rf"{word} are off .* set \$22=1, then \$20=1"):
        make().connect()


def test_a_controller_that_keeps_its_travel_to_itself_needs_it_configured(make, twin):
    for number in (130, 131, 132):
        del twin.settings[number]
    with pytest.raises(BadConfiguration, match="does not tell the travel of X; set travel or space"):
        make().connect()


@pytest.mark.parametrize("letter", ["Q", "A"])
def test_an_axis_the_controller_has_not_is_refused(make, letter):
    with pytest.raises(BadConfiguration, match=f"no axis {letter}|none for {letter}"):
        make([GrblAxis("pan_deg", letter, 100.0, travel=10.0)]).connect()


def test_settings_are_believed_when_they_were_told_twice_alike(make, bench, twin):
    faults = bench.cables["stage"].faults
    once = [lambda data: data.replace(b"$130=1500", b"$130=9500")]
    spoil = faults.spoil_reply
    faults.spoil_reply = lambda data, at_s: spoil(once.pop()(data) if once and b"$130" in data else data, at_s)
    stage = make()
    stage.connect()
    assert not once
    assert stage.travel()["z_mm"].high == 1500.0


def test_reports_in_inches_and_work_coordinates_are_understood(homed, twin, bench):
    homed.move_to(z_mm=508.0, x_mm=100.0)
    twin.settings[13] = 1
    twin.settings[10] = 0
    twin.offset(-10.0, 5.0, 0.0)
    homed.link._settings[13] = 1.0
    for _ in range(40):  # the offset is told in some reports only
        homed.link._transport.write(b"?")
    bench.clock.sleep(0.1)
    assert homed.position() == pytest.approx({"z_mm": 508.0, "x_mm": 100.0}, abs=0.03)  # 0.001 inch


def test_the_origin_and_direction_of_an_axis_are_configured(make, bench):
    stage = make([GrblAxis("z_mm", "X", 3000.0, direction=-1), GrblAxis("x_mm", "Y", 1500.0, origin=-150.0)])
    stage.connect()
    stage.home()
    assert stage.travel()["z_mm"].low == 0.0
    assert stage.travel()["x_mm"].low == -150.0
    stage.move_to(z_mm=100.0, x_mm=-50.0)
    now_s = bench.clock.now_s()
    assert bench.world.axes["z_mm"].position(now_s) == pytest.approx(1400.0)
    assert bench.world.axes["x_mm"].position(now_s) == pytest.approx(100.0)


def test_along_a_slanted_line_no_axis_exceeds_its_feed(homed, bench):
    homed.move_to(z_mm=0.0, x_mm=0.0)
    begin_s = bench.clock.now_s()
    homed.move_to(z_mm=400.0, x_mm=290.0)
    moments = [begin_s + i / 10 for i in range(int(10 * (bench.clock.now_s() - begin_s)))]
    for name, feed in (("z_mm", 3000.0), ("x_mm", 1500.0)):
        fastest = max(abs(bench.world.axes[name].velocity(t)) for t in moments) * 60
        assert fastest <= feed * 1.001  # the feed is told to a tenth of a millimetre per minute
    assert fastest == pytest.approx(1500.0, rel=0.001)


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


@pytest.mark.parametrize(("code", "word"), [(1, "hard limit"), (3, "reset while moving"), (17, "motor driver")])
def test_an_alarm_is_named_and_homing_recovers_from_it(homed, bench, twin, code, word):
    bench.cables["stage"].happen(lambda now_s: twin.alarm(code, now_s))
    bench.clock.sleep(0.1)
    with pytest.raises(Alarm, match=word):
        homed.move_to(z_mm=100.0)
    homed.home()
    homed.move_to(z_mm=100.0)


def test_a_lost_answer_does_not_put_the_conversation_out_of_step(homed, bench):
    faults = bench.cables["stage"].faults
    now_s = bench.clock.now_s()
    faults.silent = ((now_s, now_s + 0.5),)
    with pytest.raises(NoAnswer):
        homed.link.command("$G", 0.3)
    bench.clock.sleep(0.5)
    assert any(getattr(event, "tag", "") == "GC" for event in homed.link.command("$G"))
    homed.move_to(z_mm=100.0)


def test_a_board_that_must_not_be_reset_keeps_its_position(bench):
    def connected(reset_on_open, dtr):
        wire = SerialTransport(bench.address("stage"), GrblParser, clock=bench.clock, dtr=dtr)
        stage = GrblStage(wire, AXES, clock=bench.clock, reset_on_open=reset_on_open)
        stage.connect()
        return stage

    stage = connected("expect", None)
    stage.home()
    stage.move_to(z_mm=700.0)
    stage.close()
    stage = connected("avoid", False)
    assert stage.position()["z_mm"] == pytest.approx(700.0)
    assert not stage.condition().usable  # it cannot know what happened meanwhile
    stage.close()


def test_what_the_controller_refuses_is_named(homed):
    with pytest.raises(Rejected, match="unsupported G-code") as refused:
        homed.link.command("G5 X1")
    assert refused.value.code == "error:20"


def test_a_move_beyond_its_time_is_stopped(homed, twin):
    twin.settings[110] = 60.0  # fifty times slower than the driver was told
    with pytest.raises(NoAnswer, match="still moves after"):
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
    say, twin._say = twin._say, lambda *lines: None
    return lambda: setattr(twin, "_say", say)


def test_homing_that_ends_without_an_answer_is_reset(make, bench, twin):
    stage = make()
    stage.connect()
    twin.settings[25] = 1.0  # it searches for hours
    stage._homing_limit_s = lambda: 1.0
    hears_again = deaf(twin)
    with pytest.raises(NoAnswer):
        stage.home()
    assert not bench.world.axes["z_mm"].moves(bench.clock.now_s())
    assert not stage.condition().usable
    hears_again()
    twin.settings[25] = 3000.0
    del stage._homing_limit_s
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


def test_motors_that_let_go_between_moves_are_doubted(make, twin):
    stage = make()
    stage.connect()
    assert stage.condition().doubt is None
    twin.settings[1] = 25
    stage.connect()
    doubt = stage.condition().doubt
    assert "let go 25 ms after each move" in doubt.reason
    assert "set $1=255" in doubt.remedy


def test_a_door_is_named_and_the_move_goes_on_from_where_it_stood(homed, bench, twin):
    def open_the_door():
        bench.clock.sleep(1.0)
        bench.cables["stage"].happen(lambda now_s: twin.door(True, now_s))

    moved, _ = bench.clock.together(lambda: homed.move_to(z_mm=100.0), open_the_door)
    assert isinstance(moved, Held)
    bench.clock.sleep(1.0)
    with pytest.raises(Held, match="stands at the door; close it and resume"):
        homed.move_to(z_mm=100.0)
    assert not homed.moving()
    with pytest.raises(Held, match="stands at the door"):
        homed.resume()
    bench.cables["stage"].happen(lambda now_s: twin.door(False, now_s))
    with pytest.raises(Held, match="which is closed again; resume"):  # closing alone starts nothing
        homed.move_to(z_mm=100.0)
    assert "at the door" in homed.condition().word
    homed.resume()
    homed.move_to(z_mm=100.0)
    assert homed.position()["z_mm"] == pytest.approx(100.0)


def test_a_feed_hold_is_named(homed, bench):
    homed.link.write(b"!")
    with pytest.raises(Held, match="feed hold was pressed; resume"):
        homed.move_to(z_mm=100.0)
    homed.resume()
    homed.move_to(z_mm=100.0)


@pytest.mark.slow
def test_a_feed_override_is_named_and_waited_for(homed, twin, bench):
    twin.feed_override = 40
    for _ in range(20):  # told in some reports only
        homed.link._transport.write(b"?")
    bench.clock.sleep(0.1)
    assert "the feed override stands at 40 %" in homed.condition().word
    twin.settings[110] = 0.45 * 3000.0  # slower than half its feed: too slow without the override
    homed.move_to(z_mm=1000.0)
    twin.settings[110] = 60.0
    with pytest.raises(NoAnswer, match="the feed override stands at 40 %; set the override to 100 %"):
        homed.move_to(z_mm=100.0)


def test_a_port_with_something_else_is_not_taken_for_grbl(bench):
    stage = GrblStage(
        SerialTransport(bench.address("rangefinder"), GrblParser, clock=bench.clock), AXES, clock=bench.clock
    )
    with pytest.raises(DeviceError, match="no GRBL controller greets"):
        stage.connect()
    stage.close()


def rebuilt(bench, **options):
    """The bench's stage behind another controller."""
    axes = {"X": bench.world.axes["z_mm"], "Y": bench.world.axes["x_mm"], "Z": bench.world.axes["y_mm"]}
    outputs = Outputs(spindle=bench.world.set_lamp)
    cable = Cable(GrblController(axes, outputs=outputs, **options), bench.clock)
    bench.devices["stage"], bench.cables["stage"] = cable.device, cable
    plug(f"{bench.name}/stage", cable)
    return cable.device


def goes_everywhere(stage, bench):
    """Homes, goes to both ends of each axis, and the world agrees to a hundredth of a millimetre."""
    stage.connect()
    stage.home()
    for end in ("low", "high"):
        goal = {name: getattr(travel, end) for name, travel in stage.travel().items()}
        stage.move_to(**goal)
        assert stage.position() == pytest.approx(goal, abs=0.01)
        there = {name: bench.world.axes[name].position(bench.clock.now_s()) for name in goal}
        assert there == pytest.approx(goal, abs=0.01)


def test_a_long_move_on_a_slow_controller_has_the_time_it_needs(make, twin, bench):
    # GRBL's own $110 and $120, under the 3000 mm/min that are asked for
    for i in range(3):
        twin.settings[110 + i], twin.settings[120 + i] = 500.0, 10.0
    stage = make()
    stage.connect()
    stage.home()
    begin_s = bench.clock.now_s()
    stage.move_to(z_mm=100.0)
    # from 1499 mm at 500 mm/min, and the two ramps at 10 mm/s^2
    assert bench.clock.now_s() - begin_s == pytest.approx(1399 / 500 * 60 + 500 / 60 / 10, abs=1.0)


def test_with_hard_limits_the_travel_keeps_off_the_switches(make, twin, bench):
    twin.settings[21] = 1
    stage = make()
    goes_everywhere(stage, bench)
    assert stage.travel()["z_mm"] == Travel(1.0, 1499.0)
    with pytest.raises(OutsideTravel):
        stage.move_to(z_mm=1500.0)
    stage.link.command("$J=G53 G90 X0 F3000", 5.0)
    with pytest.raises(Alarm, match="hard limit"):  # what would have happened
        stage.link.pause(5.0)
    stage.home()
    stage.move_to(z_mm=100.0)


@pytest.mark.parametrize("bits", [1, 3, 5, 9, 17])
def test_every_way_grblhal_has_to_switch_homing_on(make, bench, bits):
    rebuilt(bench, variant="grblHAL", settings={22: bits, 27: 0})
    goes_everywhere(make(), bench)


def test_grblhal_moves_after_a_line_that_was_wrong(make, bench):
    rebuilt(bench, variant="grblHAL")
    stage = make()
    stage.connect()
    stage.home()
    with pytest.raises(Rejected, match="unsupported"):
        stage.link.command("G5 X1")
    stage.move_to(z_mm=100.0)  # it would refuse this with the same error


def test_a_machine_space_from_zero_upwards(make, bench):
    # built to make its homing place the origin, homing to the low end
    rebuilt(bench, options="Z", settings={23: 7, 27: 0})
    stage = make()
    goes_everywhere(stage, bench)
    assert stage.link.report().machine[0] == pytest.approx(1500.0)


def test_a_space_that_homing_contradicts_is_refused_and_can_be_configured(make, bench):
    twin = rebuilt(bench, settings={23: 7, 27: 0})
    twin.motion.forced_origin = True  # and does not tell
    stage = make([GrblAxis("z_mm", "X", 3000.0, travel=1500.0, space=(-1500.0, -1.0))])
    stage.connect()
    with pytest.raises(BadConfiguration, match=r"z_mm stands at machine position 0 after homing.*set `space`"):
        stage.home()
    assert not stage.condition().usable
    stage.close()
    goes_everywhere(make([GrblAxis("z_mm", "X", 3000.0, space=(0.0, 1500.0))]), bench)


def test_fluidnc_tells_its_ends_in_its_configuration(make, bench):
    twin = rebuilt(bench, variant="FluidNC", options="Z", settings={23: 7, 27: 0, 1: 25})
    twin.job = "SD:12.50,/jobs/a part.nc"
    stage = make()
    goes_everywhere(stage, bench)
    assert stage.envelopes["z_mm"].low == 0.0
    assert "let go 25 ms" in stage.condition().doubt.reason


def test_grbl_is_reset_again_where_it_did_not_hear(homed, bench, twin):
    bench.cables["stage"].happen(lambda now_s: twin.alarm(1, now_s))
    homed.home()  # at once, while GRBL is deaf
    homed.move_to(z_mm=100.0)


def test_a_lamp_that_a_reset_has_switched_off_says_so(make, bench):
    rebuilt(bench)
    stage = make()
    stage.connect()
    stage.home()
    light = GrblLight(stage.link, clock=bench.clock, owns_link=False)
    light.connect()
    light.set_level(0.5)
    assert light.level() == 0.5
    stage.emergency_stop()
    bench.clock.sleep(1.0)
    assert light.level() == 0.0
    assert "a reset of the controller ended its 50 %" in light.condition().word
    assert light.condition().remedy == "set the level again"
    stage.home()
    light.set_level(0.5)
    assert light.level() == 0.5
    assert light.condition().usable
