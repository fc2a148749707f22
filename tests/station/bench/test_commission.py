"""Commissioning of a stage at the simulated bench: consent, reported settings, recommended changes, the table."""

import tomllib

import pytest

from simulators.devices.serial_device import Cable, plug, unplug
from simulators.devices.tmcl import TmclModule
from simulators.world.motion import Axis
from station.bench.commission import commission
from station.bench.opening import make_bench, simulated_bench, simulated_tables
from station.bench.twins import twin_of


class ScriptedOperator:
    """Answers questions that hold a word; no to all others."""

    def __init__(self, agreed=(), lengths=()):
        self.agreed, self.lengths = agreed, dict(lengths)
        self.reported = []

    def show(self, words):
        self.reported.append(words)

    def agrees(self, question):
        return any(word in question for word in self.agreed)

    def measures(self, question):
        return next((length for word, length in self.lengths.items() if word in question), None)

    @property
    def text(self):
        return "\n".join(self.reported)


@pytest.fixture
def bench(tmp_path):
    bench = simulated_bench(tmp_path, virtual_time=True)
    yield bench
    bench.close()


@pytest.fixture
def take(bench, tmp_path):
    """Commission the stage with this person, after its controller and its table were changed."""

    def take(operator, settings=None, **axis):
        bench.simulated.devices["stage"].settings.update(settings or {})
        table = simulated_tables(bench.simulated.address, tmp_path)["stage"]
        table["axes"][0] |= axis
        own = make_bench({"stage": table}, folder=tmp_path, clock=bench.clock)
        own.connect()
        try:
            return tomllib.loads(commission("stage", own.stage, table, operator, bench.clock))["devices"]["stage"]
        finally:
            own.close()

    return take


def test_nothing_moves_without_consent(take, bench):
    operator = ScriptedOperator()
    take(operator)
    assert "stage was not moved" in operator.text
    assert bench.simulated.world.axes["z_mm"].extremes() == (750.0, 750.0)  # where it stood


def test_it_is_driven_from_end_to_end_timed_and_measured(take, bench):
    operator = ScriptedOperator(("Homing", "z_mm"), {"z_mm": 1500.0})
    table = take(operator)
    # 1500 mm at 50 mm/s and 200 mm/s^2: 30.25 s, and two polls of 0.2 s until it is known to stand
    assert "z_mm moved 1500 in 30." in operator.text
    assert "took" not in operator.text
    assert "ruler" not in operator.text
    low, high = bench.simulated.world.axes["z_mm"].extremes()
    assert (low, high) == pytest.approx((0.0, 1500.0))
    assert bench.simulated.world.axes["x_mm"].position(bench.clock.now_s()) == pytest.approx(299.0)  # not agreed to
    assert table["axes"][0] == {"name": "z_mm", "letter": "X", "feed_per_min": 3000.0}


def test_what_the_controller_cannot_do_is_written_as_it_can(take):
    operator = ScriptedOperator()
    table = take(operator, {110: 500.0, 1: 25.0, 21: 0.0})
    assert "z_mm is configured for 3000 per min, but its controller reaches 500 ($110)" in operator.text
    assert "write feed_per_min = 500, or raise $110" in operator.text
    assert "set $1=255" in operator.text
    assert "set $21=1" in operator.text
    assert table["axes"][0]["feed_per_min"] == 500.0


@pytest.mark.parametrize(("homing", "reported"), [(17.0, True), (21.0, False)])
def test_a_grblhal_that_moves_unhomed_is_to_be_locked(take, homing, reported):
    operator = ScriptedOperator()
    take(operator, {22: homing, 44: 4.0})
    assert ("set $22=21, which locks it until it is homed" in operator.text) == reported


def test_a_ruler_corrects_the_steps_per_millimetre(take):
    operator = ScriptedOperator(("Homing", "z_mm"), {"z_mm": 1485.0})
    take(operator)
    # it went 1485 where 1500 was meant: 250 steps per mm are too few by 1500 / 1485
    assert "z_mm moved 1485 by the ruler instead of 1500: multiply $100 by 1.01010" in operator.text


def test_a_move_that_takes_too_long_is_named(take, bench):
    bench.simulated.devices["stage"].motion.overrides[0] = 60
    operator = ScriptedOperator(("Homing", "z_mm"))
    take(operator)
    assert "z_mm took" not in operator.text  # connecting resets the controller, and its overrides

    class Meddler(ScriptedOperator):
        def agrees(self, question):
            bench.simulated.devices["stage"].motion.overrides[0] = 60
            return super().agrees(question)

    operator = Meddler(("Homing", "z_mm"))
    take(operator)
    assert "its settings give 30.2 s: set the feed override to 100 %" in operator.text


def test_a_machine_space_of_its_own_is_written(take):
    table = take(ScriptedOperator(), space=[0.0, 1500.0])
    assert table["axes"][0]["space"] == [0.0, 1500.0]


def test_a_tmcl_stage_is_taken_too(bench, tmp_path):
    pytest.importorskip("pytrinamic", reason="pytrinamic is not installed (extra `tmcl`)")
    module = TmclModule([(Axis(0.0, 100.0, 10.0), 1 / 320)])
    module.motors[0].settings[7] = 0
    plug("commission/stage", Cable(module, bench.clock))
    axis = {"name": "z_mm", "motor": 0, "travel": [0.0, 100.0], "unit_per_step": 1 / 320}
    table = {"driver": "tmcl_stage", "port": "sim://commission/stage", "axes": [axis]}
    own = make_bench({"stage": table}, folder=tmp_path, clock=bench.clock)
    own.connect()
    operator = ScriptedOperator(("Homing", "z_mm"), {"z_mm": 99.0})
    try:
        reported = tomllib.loads(commission("stage", own.stage, table, operator, bench.clock))["devices"]["stage"]
    finally:
        own.close()
        unplug("commission/stage")
    assert reported == table
    # 16 MHz * 1500 / 2^19 and (16 MHz)^2 * 900 / 2^37 microsteps, 320 of them a millimetre
    assert "z_mm: 143.051 per s, 5238.69 per s^2, end switches on" in operator.text
    assert "z_mm releases its motor between moves (parameter 7 is 0): set a standby current" in operator.text
    assert "z_mm moved 99 by the ruler instead of 100: multiply unit_per_step by 0.99000" in operator.text
    assert "z_mm took" not in operator.text


@pytest.mark.parametrize(("driver", "key"), [("gcs", "scale"), ("zaber", "unit_per_step")])
def test_the_scale_is_named_as_in_its_table(driver, key, tmp_path):
    with twin_of(driver, tmp_path) as twin:
        own = make_bench({"stage": twin.table}, folder=tmp_path, clock=twin.clock)
        own.connect()
        name, travel = next(iter(own.stage.travel().items()))
        operator = ScriptedOperator(("Homing", name), {name: 0.9 * (travel.high - travel.low)})
        commission("stage", own.stage, twin.table, operator, twin.clock)
        own.close()
    assert f"multiply {key} by 0.90000" in operator.text
