"""The guide as lines of text: events on stdout, answers from stdin. Works with pipes and screen readers."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import singledispatchmethod
from io import StringIO
from select import select
from typing import TYPE_CHECKING, TextIO

from procedures.numbers import MTF50_HORIZONTAL, MTF50_VERTICAL
from procedures.plan import Advice, Ask, Fact, Reading
from station.common.sanitise import stated
from station.drawing.diagrams import diagram_lines
from station.guide import frontend
from station.guide.answers import parse, words
from station.guide.frontend import CONSENTS
from station.results.comparison import measurement_words, specification_words
from station.results.plane_result import line_numbers

if TYPE_CHECKING:
    from station.results.plane_result import PlaneResult

DIGITS = {"°": 1, "%": 0, "m": 2, "mm": 0, "": 2}
MIN_READ_S = 0.4
"""Time without input after which a question for consent counts as read."""
STOPS = ("s", "stop", "q", "quit")
HELP = "Enter accepts the value in [brackets]. s stops the run. Ctrl-C stops every device at once."
STOPPING = "!! Stop sent to every device."
NOTHING = "Stopped. Nothing was answered or photographed: the session is not kept."
ENDS = {
    "finished": "Finished.",
    "stopped": "Stopped. Nothing is lost: `station session resume` continues from here.",
    "emergency": "Emergency stop. Check the bench; `station session resume` homes the stages and continues from here.",
}


class LineOperator:
    """An operator at a terminal without screen control, or a program on a pipe."""

    def __init__(self, read: TextIO, write: TextIO) -> None:
        self._read = read
        self._write = write
        self._last_line = ""
        self._last_advice = ""
        self._reported: set[str] = set()
        self.asking = False
        """Whether it waits for a line; an interruption then ends the run at once."""

    def _line(self, text: str) -> None:
        if text != self._last_line:
            self._last_line = text
            self._write.write(text + "\n")
            self._write.flush()

    def notify(self, event: frontend.Event) -> None:
        """Write the event; a closed pipe is ignored."""
        try:
            self._write_event(event)
        except OSError:  # nobody reads the pipe any more; the answers still count
            self._write = StringIO()

    @singledispatchmethod
    def _write_event(self, event: object) -> None:
        raise TypeError(f"no such event: {event!r}")

    @_write_event.register
    def _(self, event: frontend.RunBegan) -> None:
        self._line(event.plan.title)
        self._line(f"Session: {event.session}")
        if event.done:
            self._line(f"Done already: {', '.join(event.done)}")
        self._line(HELP)

    @_write_event.register
    def _(self, event: frontend.StepBegan) -> None:
        self._reported.clear()
        self._line("")
        self._line(f"== {event.step.title}")
        self._line(event.step.instruction)

    @_write_event.register
    def _(self, event: frontend.StepEnded) -> None:
        self._line(f"-- {event.step.title}: {event.gave or 'done'}")

    @_write_event.register
    def _(self, event: frontend.ProgressEvent) -> None:
        count = f" ({event.done} of {event.total})" if event.total else ""
        left = f", {event.left_s:.0f} s left" if event.left_s is not None else ""
        line = f"   {event.say}{count}{left}"
        if line not in self._reported:  # repeated activities of a step are written once
            self._reported.add(line)
            self._line(line)

    @_write_event.register
    def _(self, event: frontend.FrameEvent) -> None:
        self._last_advice = event.advice.say
        for line in seen_lines(event.advice) if event.advice.say else ():
            self._line(line)

    @_write_event.register
    def _(self, event: frontend.GoalEvent) -> None:
        self._line(f"   {event.goal.say}")

    @_write_event.register
    def _(self, event: frontend.ScanEvent) -> None:
        score = event.scores[-1]
        known = score == score
        value, bar = (f"{score:.3f}", "#" * round(40 * min(max(score, 0.0), 1.0))) if known else ("unknown", "")
        self._line(f"   {event.axis.replace('_', ' ')} {event.places[-1]:8.2f}: {value:>6} {bar}")

    @_write_event.register
    def _(self, event: frontend.DiagramEvent) -> None:
        for line in diagram_lines(event.diagram, ascii=True):
            self._line(f"   {line}".rstrip())

    @_write_event.register
    def _(self, event: frontend.ProblemEvent) -> None:
        self._line(f"!! {event.reason}")
        self._line(f"   What to do: {event.remedy}.")

    @_write_event.register
    def _(self, event: frontend.Result) -> None:
        self._line(f"   Measurement: {measurement_words(event.verdict)}.")
        for plane in event.planes.values():
            self._line(f"   {plane_words(plane)}")
        if event.reason:
            self._line(f"   Why: {event.reason}.")
            self._line(f"   What to do: {event.remedy}.")
        if event.other_causes:
            self._line("   Other possible causes:")
        for cause in event.other_causes:
            self._line(f"   - {cause.reason}; {cause.remedy}.")
        for plane in event.planes.values():
            if plane.specification is not None and plane.specification.judged is not None:
                against = "; ".join(plane.specification.against)
                words = f"{plane.name} {specification_words(plane.specification.judged)}"
                self._line(f"   {words}{': ' if against else ''}{against}")
        self._line(f"   Files: {event.folder}")

    @_write_event.register
    def _(self, event: frontend.RunEnded) -> None:
        self._line("")
        self._line(NOTHING if event.empty else ENDS[event.how])
        if event.report is not None:
            self._line(f"Report: {event.report}")
        if event.certificate is not None:
            self._line(f"Certificate: {event.certificate}")

    def say_stopped(self) -> None:
        """Report at once that every device was stopped; from any thread."""
        with suppress(OSError, ValueError):
            self._write.write("\n" + STOPPING + "\n")
            self._write.flush()

    def answer(self, ask: Ask) -> Fact:
        """The answer from the next lines of stdin. Raises Stopped at the end of input, or when the operator stops."""
        question = ask.question
        if self._last_advice and question.startswith(self._last_advice):
            question = "Do that." + question.removeprefix(self._last_advice)
        while True:
            self._last_line = ""
            line = self._answer_line(question_line(replace(ask, question=question)), consent=ask.key in CONSENTS)
            if not line or line.strip().lower() in STOPS:
                self._line("" if line else "(end of input)")
                raise frontend.Stopped
            try:
                return parse(ask, line)
            except ValueError as error:
                self._line(f"   {error}")

    def _answer_line(self, question: str, *, consent: bool) -> str:
        self.asking = True
        try:
            with suppress(OSError):
                self._write.write(question)
                self._write.flush()
            if consent and self._read.isatty():
                self._discard_typed_ahead()
            line = self._read.readline()
        finally:
            self.asking = False
        if not self._read.isatty():  # where nobody typed, the answer is written down
            self._write.write(line.rstrip("\n") + "\n")
        return line

    def _discard_typed_ahead(self) -> None:
        """Discard the lines that end before a question can have been read: a second Enter begins no movement."""
        with suppress(ImportError, OSError):  # Windows; a terminal that has closed
            from termios import TCIFLUSH, tcflush

            while select([self._read], [], [], MIN_READ_S)[0]:
                tcflush(self._read, TCIFLUSH)


def question_line(ask: Ask) -> str:
    """The question with its choices and default, ready for the answer on the same line."""
    if consent := CONSENTS.get(ask.key):
        keys = f"Enter: {consent.start}; n: {frontend.NOT_NOW}; Ctrl-C: stop every device"
        return f">> {ask.question} {consent.check} [{keys}] "
    choices = f" ({', '.join(f'{i} {choice}' for i, choice in enumerate(ask.choices, 1))})" if ask.choices else ""
    if ask.kind == "confirm":
        return (
            f">> {ask.question} [Enter when done{f'; n: {frontend.NOT_NOW}' if ask.key == frontend.BY_HAND else ''}] "
        )
    unit = f" in {ask.unit}" if ask.unit and ask.default is None else ""
    default = f" [{words(ask.default, ask.unit)}]" if ask.default not in (None, "") else ""
    return f">> {ask.question}{unit}{choices}{default} "


def seen_lines(advice: Advice) -> list[str]:
    """The readings of a frame with their tolerances, then the advice."""
    numbers = [reading_words(reading) for reading in advice.readings]
    return [f"   {'; '.join(numbers)}"] * bool(numbers) + [f"   {'ok' if advice.good else '->'} {advice.say}"]


def plane_words(plane: PlaneResult) -> str:
    """A plane's verdict and MTF50, "G1 pass: MTF50 0.412 ± 0.003 by 0.408 ± 0.003", else its group LINE."""
    mtf50 = [plane.numbers[key] for key in (MTF50_HORIZONTAL, MTF50_VERTICAL) if key in plane.numbers]
    if not mtf50:
        numbers = "; ".join(line_numbers(plane))
        return f"{plane.name} {measurement_words(plane.verdict)}{': ' * bool(numbers)}{numbers}"
    both = " by ".join(stated(one.value, one.uncertainty) for one in mtf50)
    return f"{plane.name} {measurement_words(plane.verdict)}: MTF50 {both} {mtf50[0].unit}"


def reading_words(reading: Reading) -> str:
    """A number with its unit, and its tolerance where it is outside: "white 31 % (55 to 90 %)"."""
    value = f"{reading.name} {with_unit(reading.value, reading.unit)}"
    if reading.good:
        return value
    match reading.low, reading.high:
        case (None, float(high)):
            return f"{value} (at most {with_unit(high, reading.unit)})"
        case (float(low), None):
            return f"{value} (at least {with_unit(low, reading.unit)})"
        case _:
            return f"{value} ({reading.low:g} to {with_unit(reading.high or 0.0, reading.unit)})"


def with_unit(value: float, unit: str) -> str:
    """A number with its unit, rounded as the unit requires: 2.6°, 72 %, 1.55 m."""
    digits = f"{value:z.{DIGITS[unit]}f}" if unit in DIGITS else f"{value:.3g}"
    return digits + unit if unit == "°" else f"{digits} {unit}".strip()
