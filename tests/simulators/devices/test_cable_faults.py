import numpy as np
import pytest

from simulators.bench.bench import CABLE_FAULTS, cable_fault, random_fault_events
from simulators.devices.serial_device import Faults

DATA = bytes(range(256)) * 40


@pytest.fixture
def make(rng):
    return lambda **kinds: Faults(rng, **kinds)


def test_without_faults_nothing_happens(make):
    assert make().spoil(DATA, 0.0) == make().spoil_reply(DATA, 0.0) == DATA


def test_bytes_are_lost_at_the_rate_asked_for(make):
    kept = make(lost=0.1).spoil(DATA, 0.0)
    # binomial: mean 9216, sd 30
    assert len(kept) == pytest.approx(0.9 * len(DATA), abs=5 * 30)


def test_bytes_are_changed_but_not_their_number(make):
    spoilt = make(garbage=0.1).spoil(DATA, 0.0)
    assert len(spoilt) == len(DATA)
    changed = np.count_nonzero(np.frombuffer(spoilt, np.uint8) != np.frombuffer(DATA, np.uint8))
    # one in 256 is changed into itself
    assert changed == pytest.approx(0.1 * len(DATA), abs=5 * 31)


def test_chunks_are_doubled(make):
    assert make(duplicate=1.0).spoil(b"ok", 0.0) == b"okok"


def test_silence_has_a_beginning_and_an_end(make):
    faults = make(silent=((1.0, 2.0),))
    assert [faults.spoil(b"x", t) for t in (0.9, 1.0, 1.9, 2.0)] == [b"x", b"", b"", b"x"]


def test_a_delayed_reply_comes_when_its_time_has_come(make):
    faults = make(delay_s=0.5)
    assert faults.spoil_reply(b"ok", 1.0) == b""
    assert faults.next_event_s(1.0) == 1.5
    assert faults.late(1.4) == b""
    assert faults.late(1.5) == b"ok"


def test_a_slipped_reply_comes_with_the_next_one(make):
    faults = make(slip=True)
    assert [faults.spoil_reply(reply, 1.0) for reply in (b"a", b"b", b"c")] == [b"", b"a", b"b"]


def test_a_plug_comes_out_and_goes_in(make):
    faults = make(unplugged_at_s=1.0, replugged_at_s=2.0)
    assert [faults.unplugged(t) for t in (0.5, 1.0, 1.9, 2.0)] == [False, True, True, False]


def test_at_a_wrong_baud_rate_all_is_noise(make):
    assert make(wrong_baud=True).spoil(b"STRIG/1", 0.0) != b"STRIG/1"


@pytest.mark.parametrize("kind", CABLE_FAULTS)
def test_every_kind_can_be_drawn(kind, rng):
    assert cable_fault(kind, rng).rng is rng


def test_a_seed_is_a_fate():
    one, same, other = (random_fault_events(np.random.default_rng(seed), mean=20.0) for seed in (1, 1, 2))
    assert one == same != other
