"""A stage's driver of a package outside: one file of at most 180 lines is configured, listed, and proves itself."""

import importlib
import json
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.errors import BadConfiguration
from drivers.grbl import GrblOptions
from simulators.devices.serial_device import Cable
from simulators.world.clock import VirtualClock
from station.bench import device_models
from station.bench.conform import FAULTS, Broken, at_twin, soak
from tests.program import run

PACKAGE = Path(__file__).with_name("toy_package")
ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def driver(monkeypatch):
    """The package in this process; its module."""
    monkeypatch.syspath_prepend(str(PACKAGE))
    importlib.invalidate_caches()
    device_models.drivers.cache_clear()
    yield importlib.import_module("toy_stage")
    device_models.drivers.cache_clear()


@pytest.fixture
def station(driver, tmp_path, monkeypatch):
    """The program with the package on its path, in a fresh folder."""
    monkeypatch.chdir(tmp_path)
    return partial(run, code=None)


def test_it_is_one_short_file_that_contributing_shows():
    assert len((PACKAGE / "toy_stage.py").read_text().splitlines()) <= 180
    (shown,) = re.findall(
        r"```python\n(class ToyStage.*?)```", (ROOT / ".github" / "CONTRIBUTING.md").read_text(), re.S
    )
    assert (PACKAGE / "toy_stage.py").read_text().endswith(shown)


@pytest.mark.slow
def test_it_is_configured_and_listed(station, tmp_path):
    (tmp_path / "station.toml").write_text('[devices.stage]\ndriver = "toy-stage"\nport = "/dev/nowhere"\n')
    done = station("devices", "--json")
    assert done.exit_code == 3
    (row,) = json.loads(done.stdout)
    assert (row["name"], row["driver"], row["address"]) == ("stage", "toy-stage", "/dev/nowhere")
    assert "cannot open /dev/nowhere" in row["wrong"]
    (tmp_path / "station.toml").write_text('[devices.stage]\ndriver = "toy-stage"\nbaud = 1\n')
    assert "port is missing" in station("devices").stderr


@pytest.mark.slow
def test_it_conforms(station):
    done = station("conform", "toy-stage", "--json", "--operations", 100)
    assert done.exit_code == 0, done.stdout + done.stderr
    trials = {one["trial"]: one for one in json.loads(done.stdout)["trials"]}
    assert set(FAULTS) - {"none"} < set(trials)
    assert trials["soak"]["figure"] == "100 operations"
    assert trials["stops"]["figure"].startswith("40 stops")


def test_an_unknown_driver_is_refused(station):
    done = station("conform", "toy-stages")
    assert done.exit_code == 2
    assert "toy-stages has no twin" in done.stderr
    assert "alpaca_stage" in done.stderr
    assert "toy-stage" in done.stderr


def test_its_table_is_checked_like_a_built_in_one(driver):
    device_models.read_devices({"stage": {"driver": "toy-stage", "port": "/dev/ttyUSB0"}})
    assert device_models.options_of("toy-stage") is driver.ToyOptions
    with pytest.raises(BadConfiguration, match='write driver = "toy-stage"'):
        device_models.read_devices({"stage": {"driver": "toy-stag", "port": "/dev/ttyUSB0"}})


def test_a_built_in_driver_cannot_be_replaced(driver, monkeypatch):
    entry = SimpleNamespace(name="grbl", load=lambda: driver.ToyOptions)
    monkeypatch.setattr(device_models, "entry_points", lambda group: [entry])
    assert device_models.options_of("grbl") is GrblOptions


def go_on(self):
    """No halt after an error."""


def forget_reset(self, axis):
    """Where it is, whatever reference it has."""
    return self._state(axis)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "flaw", "fault", "words"),
    [
        ("_halt", go_on, "loss", "it moves after the operation has ended"),
        ("_checked", forget_reset, "reset", "it reports .* and is usable"),
    ],
)
def test_the_soak_finds_what_a_hasty_driver_does_wrong(driver, tmp_path, monkeypatch, name, flaw, fault, words):
    monkeypatch.setattr(driver.ToyStage, name, flaw)
    with at_twin("toy-stage", tmp_path) as rig, pytest.raises(Broken, match=words):
        soak(rig, np.random.default_rng(0), 500, (fault,))


def test_a_twin_loses_its_reference_when_it_is_switched_off(driver):
    clock, twin = VirtualClock(), driver.ToyTwin()
    cable = Cable(twin, clock)
    twin.receive(driver.framed("1 home"), 0.0)
    clock.sleep(10.0)
    cable.happen(twin.restart)
    twin.receive(driver.framed("2 where"), 10.0)
    assert b"2 ok unhomed 0.0000" in twin.advance(10.0)
