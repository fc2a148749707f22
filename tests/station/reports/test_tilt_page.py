"""The page of a tilt: a plane with a curvature of known numbers, its screws and their turns."""

from __future__ import annotations

import html5lib
import numpy as np
import pytest

from procedures.outcome import Outcome, Verdict
from procedures.tilt.estimate import Tilt
from procedures.tilt.plane import fit_plane
from procedures.tilt.screws import Screws, turns_for
from station.reports.tilt_page import tilt_page

SIZE_MM = (36.0, 24.0)
PLACES = np.array([(x, y) for y in (-10.0, 0.0, 10.0) for x in (-15.0, 0.0, 15.0)])


def heights(places: np.ndarray) -> np.ndarray:
    """2 um in the middle, 1.5 um/mm to the right, -0.5 down, 0.02 um/mm^2 along x."""
    x, y = places.T
    return 2 + 1.5 * x - 0.5 * y + 0.02 * x**2


@pytest.fixture(scope="module")
def tilt() -> Tilt:
    sensor = fit_plane(PLACES, heights(PLACES), np.eye(9), SIZE_MM)
    screws = Screws(first_deg=30.0)
    return Tilt(sensor, np.zeros(9), screws, turns_for(sensor, screws, with_focus=True), True)


def test_the_surface_is_the_one_that_the_heights_are_of(tilt):
    elsewhere = np.array([[-18.0, -12.0], [3.0, 7.0], [18.0, 12.0]])
    np.testing.assert_allclose(tilt.sensor.height_at(elsewhere), heights(elsewhere), atol=1e-9)


def test_the_page_tells_every_screw_and_whether_to_turn(tilt):
    page = tilt_page("G1", 5, Outcome(tilt))
    html5lib.HTMLParser(strict=True).parse(page)
    assert "5 photographs, plane G1" in page
    assert "with a probability of 1.00: turn, and measure again" in page
    for angle, move in zip((30, 150, 270), tilt.turns.moves, strict=True):
        way = "away from" if move.value > 0 else "towards"
        assert f"at {angle}°</th><td>{abs(move.value):.1f} ± {move.uncertainty:.1f} µm {way} the lens" in page
    assert "tilt horizontal" in page
    assert "mount that is thinner by that" in page


def test_a_refused_tilt_says_why():
    page = tilt_page("Y", 3, Outcome(None, Verdict.REFUSED, "no chart", "show the chart"))
    html5lib.HTMLParser(strict=True).parse(page)
    assert "No chart. Show the chart." in page
