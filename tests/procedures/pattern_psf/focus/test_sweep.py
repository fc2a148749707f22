"""The top of a sweep."""

import math

import numpy as np
import pytest

from procedures.pattern_psf.focus.sweep import best_focus


def test_the_top_of_a_sweep_is_exact_for_a_parabola_and_scatters_as_stated(rng):
    places = np.array([3.0, -1.0, 0.0, 2.0, 1.0])
    peak = best_focus(places, 1 / (2 + 0.1 * (places - 0.7) ** 2), np.full(5, 1e-3))
    assert peak is not None
    assert (peak.place, peak.score) == (pytest.approx(0.7, abs=1e-9), pytest.approx(0.5, abs=1e-12))
    assert peak.inside
    # 400 sweeps: their spread is known to 1 / sqrt(2 * 400) = 3.5 %; four of these
    places = np.linspace(-2, 2, 9)
    true = 1 / (2 + 0.04 * (places - 0.3) ** 2)
    found = [best_focus(places, true + rng.normal(0, 1e-3, 9), np.full(9, 1e-3)) for _ in range(400)]
    tops = np.array([(peak.place, peak.score) for peak in found if peak is not None])
    stated = np.array([(peak.place_uncertainty, peak.score_uncertainty) for peak in found if peak is not None])
    assert len(tops) == 400
    # the bars are enlarged where a sweep strays by chance: up to a tenth on the mean, with 6 degrees of freedom
    ratio = stated.mean(axis=0) / tops.std(axis=0)
    assert np.all((ratio > 0.86) & (ratio < 1.3))


@pytest.mark.parametrize(
    ("places", "scores"),
    [((0.0, 1.0), (0.2, 0.3)), ((0.0, 1.0, 2.0), (0.3, 0.2, 0.3)), ((0.0, 1.0, math.nan), (0.2, 0.3, 0.2))],
    ids=["two places", "a valley", "a setting that is not known"],
)
def test_what_has_no_top_gives_none(places, scores):
    assert best_focus(places, scores, [1e-3] * len(scores)) is None


def test_a_top_beyond_the_sweep_is_told_as_such():
    places = np.array([0.0, 1.0, 2.0, 3.0])
    peak = best_focus(places, 0.5 - 0.01 * (places - 5) ** 2, np.full(4, 1e-3))
    assert peak is not None
    assert not peak.inside
