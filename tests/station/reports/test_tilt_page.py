"""The page of a tilt: a plane with a curvature of known numbers, its screws and their turns."""

import html5lib

from procedures.outcome import Outcome, Verdict
from station.calibration.tilt import tilt_measurement
from station.procedure.schema import procedure_named
from station.results.record_head import RecordHead


def test_a_refused_tilt_states_the_reason():
    refused = Outcome(None, Verdict.REFUSED, "no chart", "show the chart")
    page = procedure_named("tilt").page(tilt_measurement(RecordHead("tilt"), "Y", refused)).decode()
    html5lib.HTMLParser(strict=True).parse(page)
    assert "No chart. Show the chart." in page
