import threading
import time

import pytest

from simulators.world.clock import FastClock, VirtualClock


@pytest.fixture
def clock():
    return VirtualClock()


def test_an_hour_of_sleep_takes_no_time(clock):
    begin_s = time.monotonic()
    clock.sleep(3600.0)
    assert clock.now_s() == 3600.0
    assert time.monotonic() - begin_s < 1.0


def test_sleepers_wake_in_the_order_of_their_deadlines(clock):
    woken = []

    def sleeper(duration_s):
        def work():
            clock.sleep(duration_s)
            woken.append((duration_s, clock.now_s()))

        return work

    clock.together(*(sleeper(d) for d in (3.0, 1.0, 2.0)))
    assert woken == [(1.0, 1.0), (2.0, 2.0), (3.0, 3.0)]


def test_time_waits_for_who_is_at_work(clock):
    seen = []

    def worker():
        time.sleep(0.05)  # real work, during which no time of the clock passes
        seen.append(clock.now_s())

    clock.together(worker, lambda: clock.sleep(10.0))
    assert seen == [0.0]


def test_a_wait_ends_when_another_makes_it_ready(clock):
    condition, flag = threading.Condition(), []

    def waiter():
        with condition:
            ready = clock.wait(condition, lambda: bool(flag), 100.0)
        return ready, clock.now_s()

    def teller():
        clock.sleep(5.0)
        with condition:
            flag.append(True)
            condition.notify_all()

    assert clock.together(waiter, teller)[0] == (True, 5.0)


def test_the_clock_hands_on_outcomes_and_may_be_faster(clock):
    def fails():
        raise ValueError("so it goes")

    outcome, other = clock.together(fails, lambda: 3)
    assert isinstance(outcome, ValueError)
    assert other == 3
    clock = FastClock(speed=100.0)
    begin_s = clock.now_s()
    clock.sleep(1.0)
    # it cannot be early; how late it may be is the machine's affair
    assert clock.now_s() - begin_s >= 1.0
    assert clock.real_s(clock.now_s() + 10.0) <= 0.1
