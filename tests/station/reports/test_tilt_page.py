"""The page of a tilt: a plane with a curvature of known numbers, its screws and their turns."""

from __future__ import annotations

import html5lib
import numpy as np
import pytest

from procedures.outcome import Outcome, Verdict
from procedures.tilt.estimate import Tilt
from procedures.tilt.plane import fit_plane
from procedures.tilt.screws import Screws, turns_for
from station.calibration.tilt import tilt_measurement
from station.procedure.registry import procedure_named
from station.results.record_head import RecordHead

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


def page_of(plane: str, outcome: Outcome[Tilt]) -> str:
    page = procedure_named("tilt").page(tilt_measurement(RecordHead("tilt"), plane, outcome)).decode()
    html5lib.HTMLParser(strict=True).parse(page)
    return page


def test_the_page_states_every_screw_and_whether_to_turn(tilt):
    page = page_of("G1", Outcome(tilt))
    assert "with a probability of 1.00: turn, and measure again" in page
    for angle, move in zip((30, 150, 270), tilt.turns.moves, strict=True):
        direction = "away from" if move.value > 0 else "towards"
        assert f"at {angle} degrees: {abs(move.value):.1f} ± {move.uncertainty:.1f} µm {direction} the lens" in page
    assert "mount that is thinner by that" in page


def test_a_refused_tilt_states_the_reason():
    assert "No chart. Show the chart." in page_of("Y", Outcome(None, Verdict.REFUSED, "no chart", "show the chart"))
