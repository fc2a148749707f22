"""Random operation with photographs under faults, see `tests/benchmarks/soak.py`: one short seed."""

import pytest

from drivers.shutter import StrigShutter
from tests.benchmarks import soak


@pytest.mark.slow
def test_no_position_and_no_photograph_goes_wrong_under_faults():
    counts = soak.soak_seed(4, 25)
    assert counts["photographs"] > 5


@pytest.mark.slow
def test_the_soak_notices_times_that_are_not_as_right_as_stated(monkeypatch):
    monkeypatch.setattr(StrigShutter, "within_s", lambda self, t_us: 0.0)
    with pytest.raises(soak.Broken, match=r"opened .* ms off, stated within 0\.010 ms"):
        soak.soak_seed(2, 40)
