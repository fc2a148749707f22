"""The guide as lines: output, valid input, and every way to stop."""

import io
import os
import threading

import numpy as np
import pytest

from procedures.outcome import Cause, Quantity, Verdict
from procedures.plan import Advice, Ask, Diagram, Reading
from procedures.raw import Plane
from station.guide.answers import parse
from station.guide.frontend import (
    MOVE,
    DiagramEvent,
    FrameEvent,
    ProblemEvent,
    ProgressEvent,
    Result,
    RunEnded,
    ScanEvent,
    Stopped,
)
from station.guide.line_frontend import LineOperator
from station.results.plane_result import PlaneResult

REFUSED = Verdict.REFUSED
WIDTH = Ask("width", "How wide?", "number", "mm", 300.0, low=32.0, high=3600.0)
CHOICE = Ask("trouble", "What now?", "choice", default="try again", choices=("try again", "skip", "stop"))
PLANE = Plane("G1", np.zeros((4, 4), dtype=np.float32), 1e-4)


def output_of(*events, typed="", asks=()):
    out = io.StringIO()
    plain = LineOperator(io.StringIO(typed), out)
    for event in events:
        plain.notify(event)
    answers = [plain.answer(ask) for ask in asks]
    return out.getvalue(), answers


@pytest.mark.parametrize(
    ("ask", "text", "answer"),
    [
        (WIDTH, "", 300.0),
        (WIDTH, "96,5 mm", 96.5),
        (CHOICE, "2", "skip"),
        (CHOICE, "st", "stop"),
        (CHOICE, "", "try again"),
        (Ask("done", "Do it."), "", True),
        (Ask("done", "Do it."), "n", False),
        (Ask("camera", "Which?", "text"), " D90 ", "D90"),
    ],
)
def test_typed_text_becomes_an_answer(ask, text, answer):
    assert parse(ask, text) == answer


@pytest.mark.parametrize(
    ("ask", "text", "why"),
    [
        (WIDTH, "wide", "a number in mm"),
        (WIDTH, "10", "between 32 and 3600 mm"),
        (WIDTH, "nan", "between 32 and 3600 mm"),
        (CHOICE, "s", "one of: try again, skip, stop"),
        (Ask("done", "Do it."), "what?", "Press Enter"),
        (Ask("camera", "Which?", "text"), "", "Type some text"),
    ],
)
def test_invalid_text_is_rejected_with_a_reason(ask, text, why):
    with pytest.raises(ValueError, match=why):
        parse(ask, text)


def test_an_invalid_line_repeats_the_question():
    text, (answer,) = output_of(typed="far\n5\n40\n", asks=[WIDTH])
    assert answer == 40.0
    assert text.count("How wide?") == 3


@pytest.mark.parametrize("typed", ["", "s\n", "stop\n", "Q\n"])
def test_the_end_of_input_and_the_letter_s_stop(typed):
    with pytest.raises(Stopped):
        output_of(typed=typed, asks=[WIDTH])


def test_readings_are_shown_with_their_tolerance_and_advice_once():
    readings = (
        Reading("white", 31.4, "%", 55, 90),
        Reading("s/t", 1.1, "", 1.0, 1.3),
        Reading("yaw", 2.61, "°", -1.5, 1.5),
    )
    text, _ = output_of(FrameEvent(PLANE, Advice(False, "Open up.", readings)))
    assert text.splitlines() == ["   white 31 % (55 to 90 %); s/t 1.10; yaw 2.6° (-1.5 to 1.5°)", "   -> Open up."]
    text, _ = output_of(
        FrameEvent(PLANE, Advice(False, "Open up.")), typed="\n", asks=[Ask("by_hand", "Open up. (the rail ends)")]
    )
    assert text.count("Open up.") == 1
    assert "(the rail ends)" in text


def test_problems_results_and_ends_are_written_as_lines():
    numbers = {"mtf50_horizontal": Quantity(0.412, "cycles/pixel", 0.003, "", 9)}
    planes = {"G1": PlaneResult("G1", Verdict.PASS, numbers=numbers), "B": PlaneResult("B", Verdict.REFUSED)}
    text, _ = output_of(
        ProgressEvent("exposing", 1, 3, 12.0),
        ScanEvent("z_mm", (1.0, 2.0), (0.5, float("nan"))),
        ProblemEvent("no frame came", "check the cable"),
        Result("out", planes, Verdict.REFUSED, "too dark", "expose longer", (Cause("blurred", "focus"),)),
        RunEnded("finished", "report.html"),
    )
    for line in (
        "   exposing (1 of 3), 12 s left",
        "   z mm     2.00: unknown",
        "!! no frame came",
        "   What to do: check the cable.",
        "   G1 trusted: MTF50 0.4120 ± 0.0030 cycles/pixel",
        "   B refused",
        "   Why: too dark.",
        "   Other possible causes:",
        "   - blurred; focus.",
        "Finished.",
        "Report: report.html",
    ):
        assert line.rstrip() in [one.rstrip() for one in text.splitlines()]


def test_a_closed_pipe_does_not_stop_the_run():
    class Closed(io.StringIO):
        def write(self, text):
            raise BrokenPipeError

    plain = LineOperator(io.StringIO("50\n"), Closed())
    plain.notify(ProgressEvent("exposing"))
    assert plain.answer(WIDTH) == 50.0


def test_a_diagram_is_drawn_with_its_sentence_and_table():
    diagram = Diagram(
        "gamma over s/t", (0.7, 1.0, 1.3), (1.9, 0.6, 0.4), "It is least at 1.3.", (("s/t", "gamma"), ("0.7", "1.90"))
    )
    text, _ = output_of(DiagramEvent(diagram))
    lines = text.splitlines()
    assert "gamma over s/t" in lines[10]
    assert any("o" in line for line in lines[:10])
    assert "   It is least at 1.3." in lines
    assert lines[-2:] == ["   s/t  gamma", "   0.7   1.90"]


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
def test_what_is_typed_before_a_question_for_consent_can_be_read_does_not_answer_it(monkeypatch):
    monkeypatch.setattr("station.guide.line_frontend.MIN_READ_S", 0.1)
    ours, its = os.openpty()
    os.write(ours, b"\n\n")
    with open(its) as typed:
        operator = LineOperator(typed, io.StringIO())
        threading.Timer(0.5, os.write, (ours, b"n\n")).start()
        assert operator.answer(Ask(MOVE, "Moving z.")) is False
        os.close(ours)
        with pytest.raises(Stopped):
            operator.answer(Ask(MOVE, "Moving z."))
