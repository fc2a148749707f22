"""Random work on a bench where random things go wrong: all ends in success or a stated error, in time and in order.

A hundred scenarios by default; `STATION_SCENARIOS=1000` runs the thousand of the acceptance, `STATION_SCENARIO=n` one.
"""

import hashlib
import os
import threading

import numpy as np
import pytest

from drivers.errors import DeviceError
from drivers.frames import ExposureMetadata
from simulators.bench.bench import Setup, SimulatedBench, random_trouble
from station.bench.opening import make_bench, simulated_tables

COUNT = int(os.environ.get("STATION_SCENARIOS", "100"))
SEEDS = [int(os.environ["STATION_SCENARIO"])] if "STATION_SCENARIO" in os.environ else range(COUNT)
# the longest each may take by its own deadlines, in seconds of the bench: connecting (3 tries of every question),
# homing (searching 1.5 travels twice over), moving (twice the way at its feed), a frame's patience twice over
LIMITS_S = {
    "connect": 60.0,
    "home": 1200.0,
    "move": 150.0,
    "expose": 60.0,
    "measure": 16.0,
    "feel": 30.0,
    "light": 8.0,
    "stop": 60.0,
    "turn": 60.0,
    "turn_home": 120.0,
    "emergency": 1.0,
}


def frame(opening):
    data = repr((opening.begin_s, opening.exposure_s)).encode().ljust(3000, b".")
    return hashlib.sha256(data).digest() + data


def inspect(path):
    data = path.read_bytes()
    if hashlib.sha256(data[32:]).digest() != data[:32]:
        raise ValueError("the file is damaged")
    return ExposureMetadata(exposure_s=0.02)


class Scenario:
    def __init__(self, seed, folder):
        self.threads = set(threading.enumerate())
        self.rng = np.random.default_rng([seed, 7])
        faults, fault_events = random_trouble(seed)
        setup = Setup(seed=seed, faults=faults, fault_events=fault_events, develop=frame, virtual_time=True)
        self.truth = SimulatedBench(folder, setup)
        self.clock = self.truth.clock
        self.bench = make_bench(simulated_tables(self.truth.address, folder), folder=folder, clock=self.clock)
        self.bench.devices["camera"]._inspect = inspect
        self.collected = []

    def do(self, name):
        """One piece of work: success or a stated error, within its limit."""
        begin_s = self.clock.now_s()
        try:
            result = getattr(self, name)()
        except DeviceError as error:
            result = error
        self.collected.append((name, result))
        assert result is None or (result.reason and result.remedy)
        assert self.clock.now_s() - begin_s <= LIMITS_S[name], (name, result)
        return result

    def connect(self):
        for row in self.bench.rows():
            assert row.error is None or row.error.remedy

    def target(self, stage):
        name = str(self.rng.choice(list(stage.travel())))
        travel = stage.travel()[name]
        # one in ten is outside
        return {name: float(self.rng.uniform(travel.low, travel.high) + (self.rng.random() < 0.1) * 2 * travel.high)}

    def go(self, stage):
        if not stage.travel():
            return
        goal = self.target(stage)
        stage.move_to(**goal)
        now_s = self.clock.now_s()
        for name, value in goal.items():
            assert self.truth.world.axes[name].position(now_s) == pytest.approx(value, abs=0.02), "the world disagrees"

    def move(self):
        self.go(self.bench.stage)

    def turn(self):
        self.go(self.bench.head)

    def home(self):
        self.bench.stage.home()

    def turn_home(self):
        self.bench.head.home()

    def expose(self):
        exposure = self.bench.camera.expose()
        data = exposure.path.read_bytes()
        assert hashlib.sha256(data).hexdigest() == exposure.sha256
        inspect(exposure.path)
        begin_s = float(data[32:].split(b",")[0][1:])
        # it is the frame of this very exposure: the shutter lag, and the comparison of clocks over a slow line
        assert begin_s == pytest.approx(exposure.shutter.closed_s + 0.055, abs=1.1)

    def measure(self):
        self.bench.devices["rangefinder"].measure()

    def feel(self):
        self.bench.imu.start(50.0)
        self.bench.imu.read_block(0.5)
        self.bench.imu.stop()

    def light(self):
        self.bench.light.set_level(float(self.rng.random()))

    def emergency(self):
        self.bench.emergency_stop()

    def stop(self):
        self.bench.stage.stop()

    def at_once(self, first, second):
        """The second while the first is under way."""
        pause_s = float(self.rng.uniform(0, 5))
        done = self.clock.together(lambda: self.do(first), lambda: (self.clock.sleep(pause_s), self.do(second)))
        for outcome in done:
            if isinstance(outcome, BaseException) and not isinstance(outcome, DeviceError):
                raise outcome

    def run(self):
        self.do("connect")
        self.do("home")
        self.do("turn_home")
        works = ["move", "move", "turn", "expose", "measure", "light", "home", "turn_home", "feel", "connect"]
        for _ in range(12):
            if self.rng.random() < 0.2:
                self.at_once(
                    str(self.rng.choice(["move", "home", "turn", "expose"])),
                    str(self.rng.choice(["emergency", "stop"])),
                )
            else:
                self.do(str(self.rng.choice(works)))

    def check(self):
        for name, axis in self.truth.world.axes.items():
            low, high = axis.extremes()
            assert axis.low - 1e-6 <= low <= high <= axis.high + 1e-6, f"{name} left its travel"
        self.bench.close()
        self.truth.close()
        assert set(threading.enumerate()) <= self.threads, "a thread is left"


MARKS = [pytest.mark.nightly if n % 5 > 2 else pytest.mark.slow if n % 4 else () for n in SEEDS]


@pytest.mark.parametrize("seed", [pytest.param(n, marks=marks) for n, marks in zip(SEEDS, MARKS, strict=True)])
def test_scenario(seed, tmp_path):
    scenario = Scenario(seed, tmp_path)
    try:
        scenario.run()
    finally:
        scenario.check()
