"""A driver of another package is configured, checked and made like a built-in one."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers.errors import BadConfiguration
from drivers.grbl import GrblOptions
from station.bench import device_models
from station.bench.opening import make_bench

from .added_driver import FixedOptions, FixedRangefinder


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    """The package with its entry point, as if it were installed."""
    entry = SimpleNamespace(name="fixed", load=lambda: FixedOptions)
    monkeypatch.setattr(device_models, "entry_points", lambda group: [entry] if group == "station.drivers" else [])
    device_models.drivers.cache_clear()
    yield
    device_models.drivers.cache_clear()


def test_it_is_made_with_its_options(tmp_path: Path) -> None:
    bench = make_bench({"distance": {"driver": "fixed", "distance_mm": 1500.0}}, folder=tmp_path)
    assert isinstance(bench.devices["distance"], FixedRangefinder)
    assert bench.devices["distance"].measure_mm() == 1500.0


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"driver": "fixed"}, "distance_mm is missing"),
        ({"driver": "fixed", "distance_mm": -1.0}, "must be a number above 0"),
        ({"driver": "fixd", "distance_mm": 1.0}, "driver must be the name of a driver"),
    ],
)
def test_its_table_is_checked(tmp_path: Path, table: dict[str, object], words: str) -> None:
    with pytest.raises(BadConfiguration, match=words):
        make_bench({"distance": table}, folder=tmp_path)


def test_the_nearest_name_is_proposed(tmp_path: Path) -> None:
    with pytest.raises(BadConfiguration, match='write driver = "fixed"'):
        make_bench({"distance": {"driver": "fixd", "distance_mm": 1.0}}, folder=tmp_path)


def test_a_built_in_driver_cannot_be_replaced(monkeypatch) -> None:
    entry = SimpleNamespace(name="grbl", load=lambda: FixedOptions)
    monkeypatch.setattr(device_models, "entry_points", lambda group: [entry])
    device_models.drivers.cache_clear()
    assert device_models.options_of("grbl") is GrblOptions
