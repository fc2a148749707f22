"""What a doubt about s and k that were given asks for."""

from __future__ import annotations

import pytest

from procedures.choice import Trial
from procedures.pattern_psf.trust import Doubts, _left_out
from procedures.psf import Sampling


@pytest.mark.parametrize(
    ("better", "words"),
    [((3, 13), "use -s 3 -k 13"), ((2, 17), "raise s, from a distance"), (None, "raise s, from a distance")],
)
def test_a_band_that_ends_too_soon_asks_for_s(better: tuple[int, int] | None, words: str) -> None:
    tried = Trial(2, 11, (0.41, 0.41), uncertainty=0.0004, truncation=0.0001, band_edge=0.06, better=better)
    assert tried.band_open
    doubts = _left_out(Doubts(Sampling(2, 11, "ls", ()), False, (tried,), (), []))
    assert [doubt.remedy.startswith(words) for doubt in doubts if doubt.fails] == [True]
