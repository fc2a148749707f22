import pytest

from station.drawing.style import few_ticks


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.00017), (-0.021, 0.021), (63.7, 64.6), (5.0, 5.0)])
def test_a_bar_has_some_ticks_within_its_ends(low, high):
    ticks = few_ticks(low, high)
    assert 1 <= len(ticks) <= 5
    assert all(low <= one <= high for one in ticks)
    assert len({f"{one:.3g}" for one in ticks}) == len(ticks)  # as they are written
