"""What every probe promises."""

import math

import pytest

from drivers.errors import LineLost
from drivers.interfaces import PROBE_UNITS


def test_its_quantities_have_the_units_of_the_table(probe_rig):
    probe_rig.device.connect()
    readings = probe_rig.device.read()
    assert readings
    for name, reading in readings.items():
        assert reading.unit == PROBE_UNITS[name]
        assert math.isfinite(reading.value)
        assert reading.uncertainty is None or reading.uncertainty > 0


def test_it_measures_the_world(probe_rig):
    if probe_rig.bench is None:
        pytest.skip("the truth is known at the simulated bench only")
    probe_rig.device.connect()
    truth = probe_rig.bench.world.temperature_c(probe_rig.clock.now_s())
    # written with seven digits
    assert probe_rig.device.read()["temperature"].value == pytest.approx(truth, abs=1e-4)


def test_nothing_is_read_without_a_line(probe_rig):
    with pytest.raises(LineLost):
        probe_rig.device.read()
