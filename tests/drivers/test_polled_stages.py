"""Stages that are polled, at their twins: what each protocol says, damage to it, wrong configuration."""

from contextlib import contextmanager
from unittest.mock import Mock

import pytest

from drivers.errors import (
    Alarm,
    BadConfiguration,
    EmergencyStopped,
    MoveFailed,
    NoAnswer,
    OutsideTravel,
    Rejected,
    WasReset,
)
from drivers.newport import NewportParser
from drivers.polled_stage import PolledAxis
from drivers.thorlabs import AptMessage, AptParser
from drivers.wire.connection import InStepLine, StepQuestion
from simulators.devices.serial_device import Faults
from station.bench.opening import make_bench
from station.bench.twins import TWINS, twin_of

NEW = ("esp301", "smc100", "apt", "gcs")
ALL = (*NEW, "zaber", "tmcl_stage")


@contextmanager
def stage_of(driver, folder, **changes):
    """A stage at its twin, homed; `changes` are those of its first axis' table."""
    with twin_of(driver, folder) as setup:
        first, *others = setup.table["axes"]
        table = {**setup.table, "axes": [{**first, **changes}, *others]}
        bench = make_bench({"stage": table}, folder=folder, clock=setup.clock)
        bench.twin, bench.cable = setup.cable.device, setup.cable
        try:
            yield bench
        finally:
            bench.close()


@pytest.fixture(params=NEW)
def bench(request, tmp_path):
    with stage_of(request.param, tmp_path) as bench:
        bench.stage.connect()
        bench.stage.home()
        yield bench


@pytest.fixture(params=ALL)
def homed(request, tmp_path):
    """A bench whose stage is homed, two axes of it where its twin has two."""
    if request.param == "tmcl_stage":
        pytest.importorskip("pytrinamic", reason="pytrinamic is not installed (extra `tmcl`)")
    with stage_of(request.param, tmp_path) as bench:
        bench.stage.connect()
        bench.stage.home()
        bench.line = getattr(bench.stage, "_link", bench.stage)._transport
        yield bench


def ends(stage):
    """A target at the end of each axis."""
    return {name: travel.high for name, travel in stage.travel().items()}


@pytest.mark.parametrize("order", ["_begin_move", "_begin_homing"])
def test_after_a_stop_the_other_axis_is_neither_sent_nor_searched(homed, monkeypatch, order):
    stage, before, begin, begun = homed.stage, homed.stage.position(), getattr(homed.stage, order), []
    if len(before) < 2:
        pytest.skip("its twin has one axis")

    def stopped_meanwhile(axis, *given):
        begin(axis, *given)
        begun.append(axis.name)
        stage._mover.stop()

    monkeypatch.setattr(stage, order, stopped_meanwhile)
    with pytest.raises(MoveFailed, match="stopped before all axes"):
        stage.home() if order == "_begin_homing" else stage.move_to(**ends(stage))
    assert begun == [next(iter(before))]
    homed.clock.sleep(0.2)  # it slows down
    assert not stage.moving()
    assert stage.condition().usable == (order == "_begin_move")


def test_an_axis_that_is_not_where_it_was_sent_is_stopped_before_that_is_reported(homed, monkeypatch):
    stage = homed.stage
    monkeypatch.setattr(stage, "_rest", lambda axes, limit_s: {axis: stage._state(axis) for axis in axes})  # too early
    with pytest.raises(MoveFailed, match=" stopped at"):
        stage.move_to(**ends(stage))
    homed.clock.sleep(0.2)
    assert not stage.moving()


def test_homing_whose_end_cannot_be_asked_is_stopped(homed, monkeypatch):
    stage = homed.stage
    stage.move_to(**ends(stage))
    monkeypatch.setattr(stage, "_rest", Mock(side_effect=NoAnswer("no answer", "check its power")))
    with pytest.raises(NoAnswer):
        stage.home()
    homed.clock.sleep(0.2)
    assert not stage.moving()


def test_a_stop_is_sent_past_a_request_that_is_not_answered_and_repeated(homed, monkeypatch):
    stage, state, sent = homed.stage, homed.stage._state, homed.line.transcript
    homed.line._busy = True  # somebody waits for an answer
    with pytest.raises(NoAnswer):
        stage.stop()
    homed.line._busy = False
    assert [entry.data for entry in sent.last() if entry.way == ">"][-1] == stage.stop_bytes
    refusals = [Rejected("it refused", "look")] * 2

    def refuse(axis):
        if refusals:
            raise refusals.pop()
        return state(axis)

    monkeypatch.setattr(stage, "_state", refuse)
    stage.stop()
    assert not refusals
    stage.move_to(**ends(stage))  # the line is in step again, and the position is kept


def test_a_port_that_does_not_take_the_stop_gets_an_emergency_stop(homed):
    homed.line._outgoing._turn.acquire()  # somebody's order does not leave the port
    with pytest.raises(NoAnswer, match=r"took no bytes for 0\.03 s"):
        homed.stage.stop()
    homed.line._outgoing._turn.release()
    last = homed.line.transcript.last()[-1]
    assert (last.way, last.data) == ("!", homed.stage.emergency_bytes or homed.stage.stop_bytes)
    assert not homed.stage.condition().usable


def test_an_axis_that_counts_the_other_way_moves_within_its_own_travel(tmp_path):
    with stage_of("gcs", tmp_path, scale=-1.0, zero=60.0) as bench:
        bench.stage.connect()
        travel = bench.stage.travel()["x_mm"]
        assert (travel.low, travel.high) == (-40.0, 60.0)
        bench.stage.home()
        bench.stage.move_to(x_mm=-15.0)
        assert bench.twin.axes["x_mm"].position(bench.clock.now_s()) == pytest.approx(75.0)
        with pytest.raises(OutsideTravel):
            bench.stage.move_to(x_mm=60.1)


@pytest.mark.parametrize("driver", NEW)
def test_a_speed_of_the_table_is_that_of_the_move(driver, tmp_path):
    with stage_of(driver, tmp_path, speed_per_s=5.0) as bench:
        bench.stage.connect()
        bench.stage.home()
        start_s = bench.clock.now_s()
        bench.stage.move_to(x_mm=20.0)
        # four seconds, two ramps, and two polls
        assert 4.0 < bench.clock.now_s() - start_s < 4.6


def test_a_stage_without_speed_is_refused(tmp_path):
    with stage_of("gcs", tmp_path) as bench:
        bench.twin.motors["1"].speed = 0.0
        with pytest.raises(Rejected, match=r"x_mm at .* reports a speed of 0; connect again"):
            bench.stage.connect()


def test_a_stage_that_was_switched_off_is_not_trusted(bench):
    bench.cable.happen(bench.twin.restart)
    with pytest.raises(WasReset, match=r"x_mm at .* has lost its reference"):
        bench.stage.position()
    with pytest.raises(WasReset):
        bench.stage.move_to(x_mm=1.0)


def test_an_emergency_stop_goes_out_ahead_of_a_request_that_is_not_answered(bench):
    bench.cable.faults = Faults(silent=((0.0, 1e9),))
    bench.stage.emergency_stop()
    *_, last = (entry.data for entry in bench.transcripts["stage"].last() if entry.way in ">!")
    assert last == bench.stage.stop_bytes
    with pytest.raises(EmergencyStopped):
        bench.stage.move_to(x_mm=1.0)


def test_a_line_in_step_asks_its_question_before_the_next_request():
    given = []

    class Line:
        address = "test"

        def request(self, data, answer, timeout_s, tries=1, allowed=lambda: None):
            allowed()
            given.append(data)
            for reply in {b"a": [], b"who": ["late", "me"], b"b": ["late", "answer"]}[data]:
                if (value := answer(reply)) is not None:
                    return value
            raise NoAnswer("silence", "wait")

    line = InStepLine(Line(), 0.1)
    question = StepQuestion(b"who", lambda reply: reply == "me" or None)
    with pytest.raises(NoAnswer):
        line.request(b"a", lambda reply: reply, question)
    assert line.request(b"b", lambda reply: reply if reply == "answer" else None, question) == "answer"
    assert given == [b"a", b"who", b"b"]


def test_replies_of_both_dialects():
    replies = NewportParser().feed(b"12.5\r\n1TP-0.25\r\n0, 451322, NO ERROR DETECTED\r\n12TS000033\r\n")
    assert [tuple(reply) for reply in replies] == [
        ("", "12.5"), ("1TP", "-0.25"), ("", "0, 451322, NO ERROR DETECTED"), ("12TS", "000033"),
    ]  # fmt: skip


def test_an_esp301_in_other_units_than_the_name_is_refused(tmp_path, monkeypatch):
    with (
        stage_of("esp301", tmp_path, name="x_deg") as bench,
        pytest.raises(BadConfiguration, match=r"set it to 7 with 1SN7"),
    ):
        bench.stage.connect()


def test_a_refusal_is_in_the_words_of_the_controller(tmp_path):
    with stage_of("esp301", tmp_path) as bench:
        bench.stage.connect()
        with pytest.raises(Rejected, match=r"refused PA50\.00000: motor not enabled") as refused:
            bench.stage._begin_move(bench.stage._axes[0], 50.0, lambda: None)
    assert refused.value.code == "130"


def test_a_controller_that_stopped_with_an_error_is_an_alarm(tmp_path, monkeypatch):
    with stage_of("smc100", tmp_path) as bench:
        bench.stage.connect()
        bench.stage.home()
        monkeypatch.setattr(bench.twin, "_report", lambda number, command, value: bench.twin.say(
            f"{number}{command}{'00203D' if command == 'TS' else value}"
        ))  # fmt: skip
        with pytest.raises(Alarm, match=r"x_mm at .* has stopped with error 0020"):
            bench.stage.position()


def test_a_status_without_its_data_is_no_message():
    status = bytes.fromhex("91040e008150") + bytes(14)
    damaged = bytes.fromhex("91040e000150")
    assert AptParser().feed(damaged + status) == [AptMessage(0x0491, 0x50, bytes(14))]


def test_a_target_is_approached_only_as_it_was_read_back(tmp_path, monkeypatch):
    with stage_of("apt", tmp_path) as bench:
        bench.stage.connect()
        bench.stage.home()
        heard = bench.twin._obey

        def misread(number, dest, message, now_s):
            heard(number, dest, message[:-1] + b"\x01" if number == 0x0450 else message, now_s)

        monkeypatch.setattr(bench.twin, "_obey", misread)
        with pytest.raises(NoAnswer, match="reports another target than was set"):
            bench.stage.move_to(x_mm=10.0)
        assert bench.twin.axes["x_mm"].position(bench.clock.now_s()) == 0.0


def test_a_query_that_became_the_order_to_search_is_stopped(tmp_path, monkeypatch):
    with stage_of("gcs", tmp_path) as bench:
        bench.stage.connect()
        bench.stage.home()
        bench.stage.move_to(x_mm=80.0)
        heard, damaged = bench.twin.receive, []

        def lose_a_mark(data, now_s):
            if data == b"FRF? 1\n" and not damaged:
                damaged.append(data)
                data = b"FRF 1\n"
            heard(data, now_s)

        monkeypatch.setattr(bench.twin, "receive", lose_a_mark)
        with pytest.raises(WasReset):
            bench.stage.position()
        bench.clock.sleep(1.0)
        assert damaged
        assert not bench.twin.axes["x_mm"].moves(bench.clock.now_s())
        assert bench.twin.axes["x_mm"].position(bench.clock.now_s()) > 60.0


def test_travel_of_the_table_narrows_that_of_the_controller():
    axis = PolledAxis("x_mm", travel=(5.0, 20.0))
    assert (axis.travel_between(0.0, 100.0).low, axis.travel_between(0.0, 100.0).high) == (5.0, 20.0)
    assert set(NEW) < set(TWINS)
