"""The trials of `station conform`: every stage's driver at its twin; those that they refuse are in test_toy_stage."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from drivers.errors import Alarm, MoveFailed
from simulators.devices.alpaca import AlpacaFocusers
from station.bench.conform import FAULTS, at_twin, conform, soak
from station.bench.twins import BUILT_IN, TWINS

DRIVERS = [*BUILT_IN, *TWINS, "alpaca_stage"]


@pytest.mark.slow
@pytest.mark.parametrize("driver", ["gcs", "alpaca_stage"])  # the others' are in tests/conformance/test_stage.py
def test_a_stage_keeps_its_promises(driver, tmp_path):
    with at_twin(driver, tmp_path) as rig:
        assert [one for one in conform(rig, operations=25) if not one.kept] == []


def test_an_error_of_a_real_stage_ends_its_trials(tmp_path, monkeypatch):
    def hit(*_):
        raise Alarm("a limit switch was hit", "free the axis")

    with at_twin("zaber", tmp_path) as rig:
        monkeypatch.setattr(rig.stage, "home", hit)
        results = list(conform(replace(rig, cable=None), operations=5))
    assert [(one.trial, one.kept) for one in results] == [("identifies itself", True), ("homes first", False)]


@pytest.mark.parametrize("faults", [FAULTS, ("delay",), ("loss", "garbage")])
def test_alpacas_stage_stands_a_failing_server(faults, tmp_path):
    with at_twin("alpaca_stage", tmp_path) as rig:
        assert soak(rig, np.random.default_rng(2), 12, faults) == "12 operations"


def test_a_move_that_reaches_its_server_after_the_stop_is_halted(tmp_path, monkeypatch):
    answer = AlpacaFocusers.answer

    def answer_moves_late(focusers, number, member, values):
        focusers.clock.sleep(1.0 if member == "move" else 0.0)
        return answer(focusers, number, member, values)

    with at_twin("alpaca_stage", tmp_path) as rig:
        rig.ready()
        monkeypatch.setattr(AlpacaFocusers, "answer", answer_moves_late)
        moved, stopped = rig.together(partial(rig.stage.move_to, z_mm=100.0), rig.later(0.5, rig.stage.stop))
        assert isinstance(moved, MoveFailed)
        assert stopped is None
        assert not rig.moves()
        assert rig.truth()["z_mm"] < 5.0  # at 20 mm/s it is halted within a poll


@pytest.mark.slow
@pytest.mark.parametrize("driver", [*BUILT_IN, *TWINS])
def test_a_stage_stands_every_fault(driver, tmp_path):
    with at_twin(driver, tmp_path) as rig:
        assert soak(rig, np.random.default_rng(1), 60, FAULTS) == "60 operations"


@pytest.mark.nightly
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("driver", DRIVERS)
def test_a_stage_stands_each_fault_long(driver, fault, tmp_path):
    with at_twin(driver, tmp_path) as rig:
        assert soak(rig, np.random.default_rng(1), 200, (fault,)) == "200 operations"
