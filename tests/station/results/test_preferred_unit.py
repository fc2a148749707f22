import pytest

from procedures.outcome import BadParameter
from station.bench.opening import read_config
from station.cli.psf.terms import terms_of
from station.cli.terminal.bench_options import frozen_unit
from station.results.specification_file import preferred_unit
from station.results.units import Unit
from tests.program import run


@pytest.fixture
def station_toml(tmp_path, monkeypatch):
    """station_toml(text): that of the folder in which the program is begun."""
    monkeypatch.chdir(tmp_path)
    return (tmp_path / "station.toml").write_text


def options(unit=None, config=None):
    return {"unit": unit, "config": config, "specification": None, "at": (0.2,)}


def test_station_toml_tells_the_unit_and_an_option_another(station_toml):
    assert preferred_unit() is Unit.CYCLES
    station_toml('unit = "LP/mm"\n')
    terms = terms_of(options())
    assert (terms.unit, terms.at[0].unit) == (Unit.LINE_PAIRS, Unit.LINE_PAIRS)
    assert terms_of(options("lw/ph")).unit is Unit.LINE_WIDTHS
    assert frozen_unit(None, None) == "lp/mm"
    assert frozen_unit("cycles/pixel", None) is None


def test_a_file_that_is_named_counts_before_station_toml(station_toml, tmp_path):
    station_toml('unit = "lp/mm"\n')
    other = tmp_path / "other.toml"
    other.write_text('unit = "lw/ph"\n')
    assert terms_of(options(config=other)).unit is Unit.LINE_WIDTHS


def test_what_is_no_unit_is_named(station_toml):
    station_toml('unit = "lp/inch"\n')
    with pytest.raises(BadParameter, match=r"station\.toml, line 1: unit must be one of cycles/pixel, lp/mm"):
        preferred_unit()
    run("mtf", "edge", "a.png", "--out", "out", code=2, says='it is "lp/inch"')


def test_a_unit_alone_configures_no_devices(station_toml, tmp_path):
    station_toml('unit = "lw/ph"\n')
    assert read_config(tmp_path / "station.toml") == {}
