"""How a corruption is reported."""

import math

import pytest

from procedures.corruption.family import SCATTER, SHARPENED, Corruption, threshold
from procedures.raw import UNLIKELY_IN_RAW


@pytest.mark.parametrize("places", [1, 7])
def test_a_test_fails_beyond_the_threshold_of_all_places(places: int) -> None:
    beyond, within = (SHARPENED.check(threshold(places) + by, raw=False, places=places) for by in (1e-6, -1e-6))
    assert beyond.fails
    assert not within.fails
    assert not SHARPENED.check(math.nan, raw=False, places=places).fails


def test_the_evidence_is_what_is_given_or_the_score() -> None:
    assert "(6.3 standard uncertainties)" in SHARPENED.check(6.34, raw=False).sentence
    assert SCATTER.check(6.34, "a half", raw=False).sentence.startswith("the edge scatters by a half more than")


@pytest.mark.parametrize("one", [SHARPENED, SCATTER])
def test_raw_files_have_their_own_remedy_and_prior(one: Corruption) -> None:
    raw, picture = one.check(9.0, raw=True), one.check(9.0, raw=False)
    assert (raw.remedy, picture.remedy) == (one.raw_remedy, one.remedy)
    assert "RAW" in picture.remedy
    assert (raw.prior, picture.prior) == (UNLIKELY_IN_RAW if one is SHARPENED else 1.0, 1.0)
