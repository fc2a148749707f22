"""What Zaber devices do, and what the driver makes of it."""

from itertools import pairwise

import pytest

from drivers.errors import Alarm, MoveFailed, NoAnswer, Rejected, WasReset
from drivers.interfaces import Condition
from drivers.protocols.zaber import FLAGS, REJECTIONS, ZaberParser, checksum
from drivers.zaber import ZaberAxis, ZaberStage

STEP = 0.000234375
AXES = [ZaberAxis("pan_deg", 1, STEP, zero=-30.0, speed_per_s=10.0), ZaberAxis("tilt_deg", 2, STEP, zero=-20.0)]


@pytest.fixture
def chain(bench):
    return bench.devices["head"]


@pytest.fixture
def make(wired):
    return lambda axes=AXES: wired(ZaberStage, ZaberParser, "head", axes)


@pytest.fixture
def homed(make):
    stage = make()
    stage.connect()
    stage.home()
    return stage


def sent(stage):
    return [p.data for p in stage._transport.transcript.last() if p.way == ">"]


def test_every_command_carries_its_checksum_and_an_id_of_its_own(homed):
    homed.position()
    lines = sent(homed)
    for line in lines:
        body, _, digits = line.removeprefix(b"/").rstrip(b"\n").partition(b":")
        assert digits == checksum(body)
    ids = [int(line.split()[2].split(b":")[0]) for line in lines]
    assert all(b == (a + 1) % 100 for a, b in pairwise(ids))


def test_only_the_reply_of_the_device_and_the_question_is_taken(homed, monkeypatch):
    def request(order, answer, *_):
        number = int(order.split()[2].split(b":")[0])
        late, other, own = (b"1 1 %02d OK IDLE -- 1", b"2 1 %02d OK IDLE -- 2", b"1 1 %02d OK IDLE -- 256000")
        bodies = [late % ((number - 1) % 100), other % number, own % number]
        replies = [b"@0%s:%s\r\n" % (one, checksum(b"0" + one)) for one in bodies]
        heard = ZaberParser().feed(b"!01 1 IDLE --\r\n" + b"".join(replies))
        assert len(heard) == 4
        return next(one for one in map(answer, heard) if one is not None)

    monkeypatch.setattr(homed._transport, "request", request)
    assert homed._reading(AXES[0]) == -30.0 + 256000 * STEP


def test_every_missing_device_of_the_chain_is_named(make):
    axes = [*AXES, ZaberAxis("y_mm", 5, 0.001), ZaberAxis("roll_deg", 7, 0.001)]
    with pytest.raises(NoAnswer, match="no answer from devices 5, 7"):
        make(axes).connect()


def test_an_axis_that_is_not_there_is_named(make):
    with pytest.raises(Rejected, match="there is no such axis"):
        make([ZaberAxis("pan_deg", 1, STEP, axis=3)]).connect()


def test_a_stall_is_an_alarm_that_homing_clears(homed, chain):
    chain.devices[1].motors[0].stalls = True
    with pytest.raises(Alarm, match=r"pan_deg .* stalled and stopped; remove what blocks it") as stalled:
        homed.move_to(pan_deg=10.0)
    assert stalled.value.code == "FS"
    with pytest.raises(Alarm, match="stalled"):
        homed.move_to(pan_deg=10.0)
    homed.home()
    homed.move_to(pan_deg=10.0)


def test_somebody_elses_move_is_noticed(homed, bench, chain):
    def meddle():
        bench.clock.sleep(0.5)
        bench.cables["head"].happen(lambda now_s: chain.receive(b"/1 1 move abs 0\n", now_s))

    moved, _ = bench.clock.together(lambda: homed.move_to(pan_deg=20.0), meddle)
    assert isinstance(moved, MoveFailed)


def test_answers_without_checksum_once_they_are_on_are_those_of_a_device_that_was_reset(homed, chain):
    chain.restart(homed.clock.now_s())
    with pytest.raises(WasReset, match=r"device 1 at .* was switched off and on"):
        homed.position()
    assert not homed.condition().usable
    homed.close()
    assert homed.condition() == Condition("not connected", False, "connect it")
    homed.connect()
    homed.home()
    homed.move_to(pan_deg=10.0)


def test_axes_move_together(homed, bench):
    begin_s = bench.clock.now_s()
    homed.move_to(pan_deg=0.0, tilt_deg=0.0)
    # 30 deg at 10 deg/s and 20 deg at 4 deg/s: as long as the longer, not their sum
    assert bench.clock.now_s() - begin_s < 7.0


def test_every_flag_and_every_rejection_has_a_name_and_a_remedy():
    assert all(map(all, (*FLAGS.values(), *REJECTIONS.values())))


def test_a_question_is_asked_three_times(homed, bench):
    now_s = bench.clock.now_s()
    bench.cables["head"].faults.silent = ((now_s, now_s + 60.0),)
    for ask in (homed.position, lambda: homed._status(AXES[0])):
        before = len(sent(homed))
        with pytest.raises(NoAnswer):
            ask()
        assert len(sent(homed)) == before + 3
