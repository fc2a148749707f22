"""What GRBL says against its manual, and what the driver makes of it."""

import pytest

from drivers.errors import BadConfiguration, DeviceError, NoAnswer, Rejected
from drivers.grbl import GrblStage
from drivers.protocols.grbl import PAUSES, RESUMABLE, GrblAxis, GrblParser
from drivers.transport import SerialTransport

from .axes import AXES


@pytest.mark.parametrize("variant", ["GRBL", "grblHAL", "FluidNC"])
def test_the_firmware_is_reported_by_greeting_and_questions(make, twin, variant):
    twin.program.variant = variant
    axes = [GrblAxis("z_mm", "X", 3000.0, travel=1500.0)]
    assert make(axes).connect().model == variant


def test_the_size_of_its_buffer_is_read_not_assumed(make, twin):
    twin.program.rx_bytes = 1024
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
    with pytest.raises(BadConfiguration, match="does not report the travel of X; set travel or space"):
        make().connect()


def test_pauses_are_the_states_of_the_manual():
    # gnea/grbl doc/markdown/interface.md, real-time status reports
    assert PAUSES.keys() == {("Door", 0), ("Door", 1), ("Door", 2), ("Door", 3), ("Hold", 0), ("Hold", 1)}
    assert set(RESUMABLE) == {("Door", 0), ("Hold", 0)}


def test_an_axis_without_travel_between_its_switches_is_refused(make, twin):
    twin.settings[21], twin.settings[27] = 1, 750.0
    with pytest.raises(BadConfiguration, match="z_mm has no travel between its switches"):
        make().connect()


@pytest.mark.parametrize("letter", ["Q", "A"])
def test_an_axis_the_controller_has_not_is_refused(make, letter):
    with pytest.raises(BadConfiguration, match=f"no axis {letter}|none for {letter}"):
        make([GrblAxis("pan_deg", letter, 100.0, travel=10.0)]).connect()


def test_settings_are_trusted_when_they_were_reported_twice_alike(make, bench, twin):
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
    for _ in range(40):  # the offset is reported in some reports only
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
        assert fastest <= feed * 1.001  # the feed is reported to a tenth of a millimetre per minute
    assert fastest == pytest.approx(1500.0, rel=0.001)


def test_a_lost_answer_does_not_put_the_conversation_out_of_step(homed, bench):
    faults = bench.cables["stage"].faults
    now_s = bench.clock.now_s()
    faults.silent = ((now_s, now_s + 0.5),)
    with pytest.raises(NoAnswer):
        homed.link.command("$G", 0.3)
    bench.clock.sleep(0.5)
    assert any(getattr(event, "tag", "") == "GC" for event in homed.link.command("$G"))
    homed.move_to(z_mm=100.0)


@pytest.mark.parametrize("end", [b"", b"\x15", b"("])
def test_an_order_whose_end_was_lost_is_never_carried_out(homed, bench, end):
    # it waits in the controller's line buffer for the next end of line, whoever sends it
    wire, receive = bench.cables["stage"].device, bench.cables["stage"].device.receive
    wire.receive = lambda data, now_s: receive(data.replace(b"\n", end) if b"J=" in data else data, now_s)
    with pytest.raises(NoAnswer):
        homed.move_to(z_mm=100.0)
    wire.receive, before = receive, homed.position()
    homed.link.command("$G")
    bench.clock.sleep(5.0)
    assert homed.position() == before
    homed.move_to(z_mm=200.0)
    assert homed.position()["z_mm"] == pytest.approx(200.0)


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


def test_a_port_with_something_else_is_not_taken_for_grbl(bench):
    stage = GrblStage(
        SerialTransport(bench.address("rangefinder"), GrblParser, clock=bench.clock), AXES, clock=bench.clock
    )
    with pytest.raises(DeviceError, match="no GRBL controller answers"):
        stage.connect()
    stage.close()
