"""A program that is ended while it moves stops first; the benchmark of that name does it 200 times each way."""

import os
import random
import signal

import pytest

from simulators.bench.bench import Setup, SimulatedBench
from station.common.stop_signals import guarded
from tests.benchmarks import stops
from tests.end_to_end.conftest import on_ports

PATIENCE_S = 180.0
"""How long a program may take to end, on a machine that has much else to do."""
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")]


@pytest.fixture
def bench(tmp_path):
    """A rail and a shutter on pseudo-terminals, in real time, and the station.toml of them."""
    bench = SimulatedBench(tmp_path, Setup(develop=lambda opening: b""))
    on_ports(bench, tmp_path)
    yield bench
    bench.close()


def test_an_error_in_what_a_signal_interrupts_leaves_the_exit_code():
    def interrupted():
        try:
            signal.raise_signal(signal.SIGTERM)
        except SystemExit:
            raise RuntimeError("cannot release un-acquired lock") from None

    with pytest.raises(SystemExit) as ended, guarded(lambda: None, lambda: None):
        interrupted()
    assert ended.value.code == 3


# each of them within this process: tests/station/bench/test_opening.py
@pytest.mark.parametrize(
    "number", ["SIGINT", "SIGHUP", *(pytest.param(one, marks=pytest.mark.nightly) for one in ("SIGTERM", "SIGQUIT"))]
)
def test_a_signal_during_homing_stops_and_says_so(bench, number, homing_program):
    program, axis = homing_program, bench.world.axes["z_mm"]
    while not axis.moves(bench.clock.now_s()):
        assert program.poll() is None
    program.send_signal(getattr(signal, number))
    rest, _ = program.communicate(timeout=PATIENCE_S)
    assert not axis.moves(bench.clock.now_s())
    assert program.returncode == 3
    assert "Stop sent to every device." in rest
    assert "Emergency stop." in rest
    assert ">>" not in rest  # no further question


@pytest.mark.parametrize(
    ("way", "place"),
    [("exception", "clogged"), ("INT", "gone"), ("F12", "move"), ("Ctrl-C", "move"), ("app TSTP", "move"),
     pytest.param("Ctrl-C", "homing", marks=pytest.mark.nightly),
     pytest.param("app INT", "move", marks=pytest.mark.nightly)],
)  # fmt: skip
def test_the_stop_is_on_the_wires_and_nothing_follows_it(way, place):
    count = stops.measured(way, place, 1, random.Random(1))
    assert not count.missing
    assert len(count.ms) == 1
