"""`station focus`: where photographs may come from, and what is written of each."""

import json
import math
import threading

import pytest

from drivers.errors import EmergencyStopped
from procedures.outcome import Outcome, Verdict
from station.cli.focus import entry, line, summary, until_ended
from station.guide.focus.live import FocusReading, LiveFrame
from tests.program import run


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ((), 2, "give one of them"),
        (("--simulate", "--watch", "."), 2, "give one of them"),
        (("--simulate", "-k", "8"), 2, "odd"),
        (("--watch", "none"), 4, "there is no folder"),
    ],
)
def test_what_cannot_be_meant_is_refused(options, code, words):
    run("focus", *options, code=code, says=words)


def test_a_photograph_that_cannot_be_measured_is_reported_with_its_reason(tmp_path):
    refused = Outcome(None, Verdict.REFUSED, "no chart in the photograph", "show it")
    frame = LiveFrame(tmp_path / "one.dng", Outcome(None), 0.0)
    seen = FocusReading(frame, refused, 0.2, (math.nan,), (math.nan,), None, "Focus by eye first.")
    assert line(seen) == "  1  one.dng: no chart in the photograph; show it"
    assert json.loads(json.dumps(entry(seen), allow_nan=False))["reason"] == "no chart in the photograph"
    assert summary(seen) == "none of 1 photographs could be measured"


def test_an_exposure_that_ctrl_c_has_stopped_is_the_end_and_any_other_stop_an_error():
    ended = threading.Event()

    def frames(by_ctrl_c):
        yield "frame"
        if by_ctrl_c:
            ended.set()
        raise EmergencyStopped("emergency stop", "expose again")

    with pytest.raises(EmergencyStopped):
        list(until_ended(frames(by_ctrl_c=False), ended))
    assert list(until_ended(frames(by_ctrl_c=True), ended)) == ["frame"]
