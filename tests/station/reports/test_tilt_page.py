"""The page of a tilt: a plane with a curvature of known numbers, its screws and their turns."""

import html5lib
import numpy as np

from procedures.outcome import Outcome, Verdict
from procedures.tilt.plane import fit_plane
from station.calibration.tilt import tilt_measurement
from station.procedure.schema import procedure_named
from station.results.record_head import RecordHead

SIZE_MM = (36.0, 24.0)
PLACES = np.array([(x, y) for y in (-10.0, 0.0, 10.0) for x in (-15.0, 0.0, 15.0)])


def heights(places: np.ndarray) -> np.ndarray:
    """2 um in the middle, 1.5 um/mm to the right, -0.5 down, 0.02 um/mm^2 along x."""
    x, y = places.T
    return 2 + 1.5 * x - 0.5 * y + 0.02 * x**2


def test_the_surface_is_the_one_that_the_heights_are_of():
    sensor = fit_plane(PLACES, heights(PLACES), np.eye(9), SIZE_MM)
    elsewhere = np.array([[-18.0, -12.0], [3.0, 7.0], [18.0, 12.0]])
    np.testing.assert_allclose(sensor.height_at(elsewhere), heights(elsewhere), atol=1e-9)


def test_a_refused_tilt_states_the_reason():
    refused = Outcome(None, Verdict.REFUSED, "no chart", "show the chart")
    page = procedure_named("tilt").page(tilt_measurement(RecordHead("tilt"), "Y", refused)).decode()
    html5lib.HTMLParser(strict=True).parse(page)
    assert "No chart. Show the chart." in page
