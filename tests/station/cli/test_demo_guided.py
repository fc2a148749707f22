import json
from dataclasses import replace
from pathlib import Path

import pytest

from procedures.outcome import Quantity, Verdict
from station.cli.demo import plane_lines
from station.demo.guided_demo import EventReporter
from station.guide import catalogue
from station.guide.frontend import ProblemEvent, ProgressEvent, Result, StepBegan
from station.results.plane_result import PlaneResult
from station.sessions.reader import read_session
from tests.program import run


@pytest.fixture
def printed_only(monkeypatch):
    """The pattern's plan up to printing, which needs no photographs."""
    whole = catalogue.plan_named("pattern")
    monkeypatch.setattr(catalogue, "plan_named", lambda name, folder=None: replace(whole, steps=whole.steps[:1]))


@pytest.mark.slow
def test_the_guide_runs_without_a_terminal_into_a_session(printed_only, tmp_path):
    done = run("demo", "--guided", "--out", tmp_path / "out", "--log-json")
    (folder,) = (tmp_path / "out").iterdir()
    state = read_session(folder).state
    assert (state.plan, state.ended, state.done) == ("pattern", "finished", ("print",))
    assert (folder / "chart.pdf").read_bytes().startswith(b"%PDF-")
    lines = [json.loads(line) for line in done.stderr.splitlines()]
    assert all(line["event"] == "step" for line in lines)
    assert any(str(folder / "chart.pdf") in line["message"] for line in lines)


def test_repeated_events_are_reported_once_in_a_step():
    reported = []
    reporter = EventReporter(lambda sentence, remedy: reported.append((sentence, remedy)))
    step = catalogue.plan_named("pattern").steps[0]
    again = ProgressEvent("exposing"), ("  exposing", "")
    for event in (again[0], again[0], StepBegan(step), again[0], ProblemEvent("no", "plug it in")):
        reporter.notify(event)
    assert reported == [again[1], (f"{step.title}: {step.instruction}", ""), again[1], ("no", "plug it in")]


def test_each_plane_is_one_line():
    quantity = Quantity(0.5782, "cycles/pixel", 0.0014, "MTF50", 9)
    green = PlaneResult("G1", Verdict.PASS, numbers={"mtf50_horizontal": quantity})
    planes = {"G1": green, "B": PlaneResult("B", Verdict.REFUSED, "dark")}
    result = Result(Path("out"), planes, Verdict.REFUSED, "dark", "")
    assert plane_lines(result) == ["G1: pass; MTF50, rows 0.5782 ± 0.0014 cycles/pixel", "B: refused"]
