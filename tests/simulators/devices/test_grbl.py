"""The GRBL twin against GRBL's documents: what the interface and jogging pages say it answers."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.devices.grbl import GrblController
from simulators.world.motion import Axis

RESET = b"\x18"


class Bare:
    """A controller without a cable."""

    def __init__(self, **options):
        self.now_s = 0.0
        self.axes = {"X": Axis(0.0, 200.0, 50.0), "Y": Axis(0.0, 100.0, 50.0)}
        self.twin = GrblController(self.axes, **options)
        self.twin.set_lines(True, True, 0.0)

    def ask(self, data=b"", wait_s=0.0):
        self.twin.advance(self.now_s)
        self.twin.receive(data, self.now_s)
        self.now_s += wait_s
        return self.twin.advance(self.now_s).decode().split("\r\n")[:-1]

    def state(self):
        return re.match(r"<([A-Za-z]+)", self.ask(b"?")[0])[1]


@pytest.fixture
def grbl():
    bare = Bare()
    bare.ask(wait_s=1.0)
    return bare


@pytest.fixture
def homed(grbl):
    assert grbl.ask(b"$H\n", 60.0) == ["ok"]
    return grbl


def test_it_greets_locked_when_homing_is_on():
    assert Bare().ask(wait_s=1.0) == ["", "Grbl 1.1h ['$' for help]", "[MSG:'$H'|'$X' to unlock]"]


def test_locked_it_takes_no_g_code_until_unlocked(grbl):
    assert grbl.ask(b"G0 X-1\n") == ["error:9"]
    assert grbl.ask(b"$X\n") == ["[MSG:Caution: Unlocked]", "ok"]
    assert grbl.state() == "Idle"


def test_while_homing_it_does_not_answer_status(grbl):
    assert grbl.ask(b"$H\n", 0.5) == []
    assert grbl.ask(b"?") == []
    assert grbl.ask(wait_s=60.0) == ["ok"]


def test_after_homing_it_stands_a_pull_off_from_its_switches(homed):
    assert homed.ask(b"?")[0].startswith("<Idle|MPos:-1.000,-1.000|FS:0,0")
    assert homed.axes["X"].position(homed.now_s) == 199.0


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"X", 2),
        (b"5", 1),
        (b"G5 X-1", 20),
        (b"G1 X-1", 22),
        (b"G0 G1 X-1 F1", 24),
        (b"X-1 X-2", 25),
        (b"G4", 28),
        (b"$J=X-1", 22),
        (b"$J=G0 X-1 F1", 16),
        (b"$J=G53 X-999 F1", 15),
        (b"$Q", 2),
        (b"G0 X-1 " + b"(" + b"x" * 80 + b")", None),
        (b"G0 " + b"X" * 90, 11),
    ],
)
def test_every_line_gets_one_response(homed, line, code):
    assert homed.ask(line + b"\n", 10.0) == [f"error:{code}" if code else "ok"]


def test_an_empty_line_is_ok(homed):
    assert homed.ask(b"\n  \n(comment)\n") == ["ok", "ok", "ok"]


def test_a_g_code_target_outside_is_an_alarm_that_only_reset_ends(homed):
    assert homed.ask(b"G0 X-500\n", 0.1) == ["ALARM:2"]
    assert homed.ask(RESET + b"?", 0.3) == []  # for half a second it hears nothing
    assert homed.ask(wait_s=0.2) == ["[MSG:Reset to continue]"]
    assert homed.ask(b"?$X\n") == []
    assert homed.ask(RESET)[:3] == ["ok", "", "Grbl 1.1h ['$' for help]"]
    assert homed.state() == "Alarm"


def test_a_jog_outside_is_only_an_error(homed):
    assert homed.ask(b"$J=G53 X-500 F100\n") == ["error:15"]
    assert homed.state() == "Idle"


def test_ok_means_planned_and_g4_waits_for_the_motion(homed):
    assert homed.ask(b"G1 X-51 F3000\n") == ["ok"]
    assert homed.state() == "Run"
    # 50 mm at 50 mm/s with 200 mm/s^2: 1.25 s
    assert homed.ask(b"G4 P0.01\n", 1.2) == []
    assert homed.ask(wait_s=0.1) == ["ok"]
    assert homed.state() == "Idle"


def test_jog_cancel_brakes_and_forgets_what_is_queued(homed):
    homed.ask(b"$J=G91 X-50 F3000\n$J=G91 X-50 F3000\n", 0.5)
    homed.ask(b"\x85", 1.0)
    assert homed.state() == "Idle"
    rested = homed.axes["X"].position(homed.now_s)
    assert 150 < rested < 199
    homed.now_s += 10
    assert homed.axes["X"].position(homed.now_s) == rested


def test_a_feed_hold_is_resumed_where_it_stopped(homed):
    homed.ask(b"G1 X-101 F3000\n", 1.0)
    homed.ask(b"!", 1.0)
    assert homed.state() == "Hold"
    homed.ask(b"~", 5.0)
    assert homed.state() == "Idle"
    assert homed.axes["X"].position(homed.now_s) == pytest.approx(99.0)


def test_a_reset_in_motion_loses_the_position(homed):
    homed.ask(b"G1 X-101 F3000\n", 1.0)
    output = homed.ask(RESET)
    assert output == ["ALARM:3"]
    assert homed.ask(b"?$X\n", 0.6)[:2] == ["", "Grbl 1.1h ['$' for help]"]
    assert homed.state() == "Alarm"
    assert not homed.axes["X"].moves(homed.now_s)


def test_fifteen_blocks_fit_the_planner_and_one_line_more_waits(homed):
    lines = b"".join(b"G1 X-%d F60\n" % (10 + i % 2) for i in range(20))
    output = []
    for at in range(0, len(lines), 11):
        output += homed.ask(lines[at : at + 11])
    # one is driven, fifteen are planned; the rest waits in the buffer
    assert output == ["ok"] * 16


def test_what_does_not_fit_the_receive_buffer_is_lost(homed):
    homed.ask(b"G4 P1\n")
    output = homed.ask(b"\n" * 200, 2.0)
    assert len(output) == 1 + 128


def test_reports_carry_their_fields_now_and_then(homed):
    reports = [homed.ask(b"?")[0] for _ in range(20)]
    assert sum("WCO:" in report for report in reports) == 2
    assert sum("Ov:" in report for report in reports) == 2
    assert all("FS:" in report for report in reports)


def test_settings_are_reported_and_kept(grbl):
    assert "$130=200.000" in grbl.ask(b"$$\n")
    assert grbl.ask(b"$130=150\n") == ["ok"]
    assert "$130=150.000" in grbl.ask(b"$$\n")


def test_a_dedicated_line_reports_modes_and_offsets(grbl):
    assert grbl.ask(b"$G\n")[0].startswith("[GC:")
    assert grbl.ask(b"$#\n")[0] == "[G54:0.000,0.000]"


def test_inches_are_inches(homed):
    homed.ask(b"G20 G1 X-2 F100\n", 60.0)
    assert homed.axes["X"].position(homed.now_s) == pytest.approx(200 - 50.8)


PARTS = [
    "G0", "G1", "G4", "G20", "G21", "G28", "G53", "G90", "G91", "G92", "M3", "M5", "M8", "X-1", "Y-2.5", "Z1", "F100",
    "F-1", "P0.01", "S500", "L2", "N3", "(a", ")", ";", "$", "=", "J", "x", "9", "%",
]  # fmt: skip
WORDS = st.lists(st.sampled_from([*PARTS, " "]))


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(st.lists(WORDS.map("".join), min_size=1, max_size=5))
def test_whatever_line_comes_gets_one_response(texts):
    bare = Bare(settings={22: 0, 20: 0})
    bare.ask(wait_s=1.0)
    for text in texts:
        output = bare.ask(text.encode() + b"\n", 120.0)
        responses = [line for line in output if line == "ok" or line.startswith("error:")]
        assert len(responses) == 1, (text, output)


def test_a_line_longer_than_every_buffer_is_refused_and_the_next_is_heard(homed):
    assert homed.ask(b"G0 X-" + b"1" * 500 + b"\nG21\n") == ["error:11", "ok"]


def test_a_switch_that_is_hit_is_an_alarm(homed):
    homed.ask(b"$21=1\n$20=0\n")
    # machine zero is where the switch closes: 51 mm away at 50 mm/s
    assert homed.ask(b"G1 X-51 F3000\nG4 P0.01\nG1 X1\n", 20.0) == [
        "ok", "ok", "ok", "ALARM:1", "[MSG:Reset to continue]",
    ]  # fmt: skip
    assert homed.axes["X"].position(homed.now_s) == pytest.approx(200.0, abs=1e-6)
    assert not homed.axes["X"].moves(homed.now_s)


def test_reports_in_inches_have_four_decimals(homed):
    homed.ask(b"$13=1\n")
    assert homed.ask(b"?")[0].startswith("<Idle|MPos:-0.0394,-0.0394|FS:0.0,0")


def test_a_jog_has_its_own_errors(homed):
    lines = [b"$J=X-2", b"$J=X-2 F-5", b"$J=X-2 F100 N-1", b"$J=X-2 F100 M3", b"$J=X-2 F100 S5", b"$J=G54 X-2 F100"]
    assert [homed.ask(line + b"\n")[0] for line in lines] == [f"error:{n}" for n in (22, 4, 4, 16, 36, 16)]


def test_a_held_controller_executes_no_line_until_it_goes_on(homed):
    homed.ask(b"!")
    assert homed.ask(b"$G\n", 5.0) == []
    assert homed.ask(b"~")[-1] == "ok"


def test_kept_lines_run_at_every_start(homed):
    homed.ask(b"$N0=G20 M8\n")
    assert homed.ask(RESET, 1.0)[-1] == ">G20M8:ok"
    assert "G20" in homed.ask(b"$G\n")[0]


@pytest.mark.parametrize(
    ("variant", "homing", "state"), [("GRBL", 1, "Alarm"), ("grblHAL", 17, "Idle"), ("grblHAL", 5, "Alarm")]
)
def test_power_that_was_off_forgets_the_place_and_keeps_the_settings(variant, homing, state):
    # grblHAL's simulator with $22=17 moves unhomed after power-up, its bit 2 would keep it from that
    bare = Bare(variant=variant)
    bare.ask(wait_s=1.0)
    bare.ask(b"$22=%d\n" % homing)
    bare.ask(b"$H\n", 60.0)
    bare.ask(b"$J=G53X-50F1000\n", 1.0)
    bare.twin.restart(bare.now_s, 2.0)
    assert bare.ask(b"?", 2.0) == []
    stands = bare.axes["X"].position(bare.now_s)
    assert bare.ask(wait_s=1.0)[1].startswith("Grbl")
    assert bare.ask(b"?")[0].startswith(f"<{state}|MPos:0.000,0.000|")
    assert f"$22={homing}" in bare.ask(b"$$\n")
    assert bare.axes["X"].position(bare.now_s) == stands
