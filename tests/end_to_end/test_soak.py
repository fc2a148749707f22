"""Random operation with photographs under faults, see `tests/benchmarks/soak.py`: one short seed, and more at night."""

import importlib.util
import sys
from pathlib import Path

import pytest

from drivers.shutter import StrigShutter

SOAK = Path(__file__).parents[1] / "benchmarks" / "soak.py"


@pytest.fixture(scope="module")
def soak():
    spec = importlib.util.spec_from_file_location("soak", SOAK)
    module = importlib.util.module_from_spec(spec)
    sys.modules["soak"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_no_position_and_no_photograph_goes_wrong_under_faults(soak):
    counts = soak.soak_seed(4, 25)
    assert counts["photographs"] > 5


@pytest.mark.slow
def test_the_soak_notices_times_that_are_not_as_right_as_stated(soak, monkeypatch):
    monkeypatch.setattr(StrigShutter, "within_s", lambda self, t_us: 0.0)
    with pytest.raises(soak.Broken, match=r"opened .* ms off, stated within 0\.010 ms"):
        soak.soak_seed(2, 40)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(4))
def test_a_soak_of_500_operations(soak, seed):
    assert soak.soak_seed(seed, 500)["photographs"] > 100
