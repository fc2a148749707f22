"""The GRBL twin, driven by somebody else's sender: it counts characters into the buffer of 128 and shares no line."""

import time

import pytest

from simulators.bench.bench import Setup, SimulatedBench

grbl_streamer = pytest.importorskip("grbl_streamer", reason="grbl-streamer is not installed (extra `peers`)")

PATIENCE_S = 20.0


class Sender:
    def __init__(self, port):
        self.events = []
        self.sender = grbl_streamer.GrblStreamer(lambda event, *data: self.events.append((event, data)))
        self.sender.cnect(port, 115200)

    def until(self, happened):
        begin_s = time.monotonic()
        while not any(happened(event, data) for event, data in list(self.events)):
            assert time.monotonic() - begin_s < PATIENCE_S, self.events[-5:]
            time.sleep(0.02)

    def settle(self):
        """Until nothing more comes: a remaining answer would be counted for another line."""
        count = -1
        while count != len(self.events):
            count = len(self.events)
            time.sleep(0.2)

    def named(self, name):
        return [data for event, data in self.events if event == name]


@pytest.fixture
def bench(tmp_path):
    bench = SimulatedBench(tmp_path, Setup(develop=lambda opening: b"raw", speed=60.0))
    yield bench
    bench.close()


@pytest.fixture
def sender(bench):
    sender = Sender(bench.open_ports(("stage",))["stage"][0])
    sender.until(lambda event, data: event == "on_boot")
    yield sender
    sender.sender.disconnect()


def test_a_job_streamed_by_counting_characters_ends_where_it_should(bench, sender):
    sender.sender.homing()
    sender.until(lambda *_: not bench.devices["stage"].locked)
    sender.settle()
    sender.sender.incremental_streaming = False
    steps = [f"G1 X{-1000 + i % 7} Y{-100 - i % 5} F3000" for i in range(80)]
    sender.sender.write("\n".join(["G21", "G90", *steps, "G0 X-1000 Y-50 Z-20"]))
    sender.events.clear()
    sender.sender.job_run()
    sender.until(lambda event, data: event == "on_job_completed")
    bench.clock.sleep(30.0)  # its last lines are planned, not done
    assert not sender.named("on_error")
    world, now_s = bench.world.axes, bench.clock.now_s()
    there = [world[name].position(now_s) for name in ("z_mm", "x_mm", "y_mm")]
    assert there == pytest.approx([500.0, 250.0, 180.0])


def test_before_homing_it_is_locked_and_reports_it(sender):
    sender.sender.send_immediately("G0 X-10")
    sender.until(lambda event, data: event == "on_error" and data[0] == "error:9")
