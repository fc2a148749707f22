"""A program that is suspended in mid-move: the box of its bench releases the motors, and the program says so later."""

import os
import signal
import time
from pathlib import Path

import pytest

from simulators.bench.bench import Setup, SimulatedBench
from tests.end_to_end.conftest import on_ports

PATIENCE_S = 60.0
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")]


class Recorded(SimulatedBench):
    """A bench whose box enables the motors; when it heard heartbeats and released the motors, by the bench's clock."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, Setup(develop=lambda opening: b"", motors_on_box=True))
        self.beats: list[float] = []
        self.releases: list[float] = []
        self.enabled = False
        box = self.devices["shutter"]
        receive, enable = box.receive, box.enable

        def heard(data: bytes, now_s: float) -> None:
            if b"BEAT" in data:
                self.beats.append(now_s)
            receive(data, now_s)

        def enabled(on: bool, now_s: float) -> None:
            if self.enabled and not on:
                self.releases.append(now_s)
            self.enabled = on
            enable(on, now_s)

        box.receive, box.enable = heard, enabled


@pytest.fixture
def bench(tmp_path):
    bench = Recorded(tmp_path)
    on_ports(bench, tmp_path, watchdog={"driver": "strig_watchdog", "box": "shutter", "stages": ["stage"]})
    yield bench
    bench.close()


def test_the_motors_are_released_while_the_program_is_suspended(bench, homing_program, read_until):
    program, axis = homing_program, bench.world.axes["z_mm"]
    while not (bench.enabled and axis.moves(bench.clock.now_s()) and bench.beats):
        assert program.poll() is None
        time.sleep(0.001)
    program.send_signal(signal.SIGSTOP)
    end_s = time.monotonic() + PATIENCE_S
    while not bench.releases and time.monotonic() < end_s:
        time.sleep(0.001)
    (released_s,) = bench.releases
    assert 0.1 - 1e-6 <= released_s - bench.beats[-1] <= 0.15
    assert not axis.moves(bench.clock.now_s())
    program.send_signal(signal.SIGCONT)
    read_until(program.stdout, "released the motors: no heartbeat of this program came in time")
    program.send_signal(signal.SIGTERM)
    program.communicate(timeout=PATIENCE_S)
    assert not axis.moves(bench.clock.now_s())
