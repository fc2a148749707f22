"""The delay of a cable, from taps that two inertial units feel."""

import pytest

from drivers.errors import BadConfiguration
from simulators.bench.bench import Setup, SimulatedBench
from station.bench.common_event import LISTEN_S, NoCommonEvent, latencies
from station.bench.opening import make_bench, simulated_tables


@pytest.fixture
def tapped(tmp_path):
    """tapped(delay_s, jitter_s, unit): the delays measured, with taps within the first second of each record."""
    opened = []

    def measure(delay_s=0.0, jitter_s=0.0, unit="imu", taps=True):
        world = SimulatedBench(tmp_path, Setup(seed=3, virtual_time=True))
        tables = simulated_tables(world.address, tmp_path)
        tables = {name: tables[name] for name in ("shutter", unit)}
        tables["reference"] = {"driver": "strig_imu", "box": "shutter"}
        bench = make_bench(tables, folder=tmp_path, clock=world.clock)
        opened.extend((bench, world))
        bench.connect()
        world.cables[unit].faults.delay_s, world.cables[unit].faults.jitter_s = delay_s, jitter_s

        def tap(name, n):
            assert name == unit
            if taps:
                for i in range(3):  # of a hand: the body rings for a while after each
                    world.world.shake(world.clock.now_s() + 0.4 + 0.037 * n + 0.31 * i)

        return latencies(bench, tap)[unit]

    yield measure
    for one in opened:
        one.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unit", "delay_ms", "jitter_ms"),
    [
        pytest.param("imu", 0.0, 0.0, marks=pytest.mark.nightly),
        pytest.param("fast_imu", 4.0, 2.0, marks=pytest.mark.nightly),
        ("imu", 40.0, 4.0),
    ],
)
def test_a_tap_measures_the_delay_of_a_cable_to_milliseconds(tapped, unit, delay_ms, jitter_ms):
    found = tapped(delay_ms / 1000, jitter_ms / 1000, unit)
    assert found.by == "common event"
    # the least delay is found, to which jitter adds; the filters of the box's unit bound it
    assert abs(found.latency_s - delay_ms / 1000) <= found.within_s
    assert found.within_s < 0.0035


def test_units_that_feel_nothing_in_common_say_so(tapped):
    with pytest.raises(NoCommonEvent, match="must feel the tap"):
        tapped(taps=False)


def test_a_tap_needs_a_unit_on_the_box(tmp_path):
    world = SimulatedBench(tmp_path, Setup(virtual_time=True))
    tables = {name: simulated_tables(world.address, tmp_path)[name] for name in ("shutter", "imu")}
    bench = make_bench(tables, folder=tmp_path, clock=world.clock)
    try:
        with pytest.raises(BadConfiguration, match="on the shutter's box with one on a cable"):
            latencies(bench, lambda name, n: None)
    finally:
        bench.close()
        world.close()
    assert LISTEN_S > 1.0
