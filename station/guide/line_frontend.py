"""The guide as plain lines: what happens on stdout, answers from stdin. Works with pipes, and for screen readers."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import singledispatchmethod
from io import StringIO
from typing import TYPE_CHECKING, TextIO

from procedures.numbers import MTF50_HORIZONTAL, MTF50_VERTICAL
from procedures.plan import Advice, Ask, Fact, Reading
from station.common.uncertainty_text import stated
from station.drawing.diagrams import diagram_lines
from station.guide.answers import parse, words
from station.guide.frontend import (
    MOVE,
    CurveSeen,
    Doing,
    Event,
    Result,
    RunBegan,
    RunEnded,
    Seen,
    Shown,
    StepBegan,
    StepEnded,
    Stopped,
    Trouble,
)
from station.results.verdict_words import measurement_words, specification_words

if TYPE_CHECKING:
    from station.results.plane_result import PlaneResult

DIGITS = {"°": 1, "%": 0, "m": 2, "mm": 0, "": 2}
"""Decimals of the numbers told, by their unit."""
STOPS = ("s", "stop", "q", "quit")
HELP = "Enter takes what stands in [brackets]. s stops. Ctrl-C stops everything at once."
STOPPING = "!! Every device was told to stop."
NOTHING = "Stopped. Nothing was answered or photographed yet: no session is kept."
ENDS = {
    "finished": "Finished.",
    "stopped": "Stopped. Nothing is lost: `station session resume` goes on from here.",
    "emergency": "Emergency stop. Check the bench; `station session resume` goes on from here after homing.",
}


class Plain:
    """An operator before a plain terminal, or a program on a pipe."""

    def __init__(self, read: TextIO, write: TextIO) -> None:
        self._read = read
        self._write = write
        self._shown = ""
        self._advised = ""
        self._done: set[str] = set()
        self.asking = False
        """Whether it waits for a line: an interruption then ends the run at once."""

    def _line(self, text: str) -> None:
        """One line; the same line twice in a row is told once."""
        if text != self._shown:
            self._shown = text
            self._write.write(text + "\n")
            self._write.flush()

    # --- what is told

    def hear(self, event: Event) -> None:
        """Write it down; whoever does not read any more misses it."""
        try:
            self._tell(event)
        except OSError:  # the reader of the pipe has gone: the answers decide what follows
            self._write = StringIO()

    @singledispatchmethod
    def _tell(self, event: object) -> None:
        raise TypeError(f"no such event: {event!r}")

    @_tell.register
    def _(self, event: RunBegan) -> None:
        self._line(event.plan.title)
        self._line(f"Session: {event.session}")
        if event.done:
            self._line(f"Done already: {', '.join(event.done)}")
        self._line(HELP)

    @_tell.register
    def _(self, event: StepBegan) -> None:
        self._done.clear()
        self._line("")
        self._line(f"== {event.step.title}")
        self._line(event.step.instruction)

    @_tell.register
    def _(self, event: StepEnded) -> None:
        self._line(f"-- {event.step.title}: {event.gave or 'done'}")

    @_tell.register
    def _(self, event: Doing) -> None:
        count = f" ({event.done} of {event.total})" if event.total else ""
        left = f", {event.left_s:.0f} s left" if event.left_s is not None else ""
        line = f"   {event.say}{count}{left}"
        if line not in self._done:  # what is done again and again in a step is told once
            self._done.add(line)
            self._line(line)

    @_tell.register
    def _(self, event: Seen) -> None:
        self._advised = event.advice.say
        for line in seen_lines(event.advice) if event.advice.say else ():
            self._line(line)

    @_tell.register
    def _(self, event: CurveSeen) -> None:
        self._line(f"   {curve_line(event)}")

    @_tell.register
    def _(self, event: Shown) -> None:
        for line in diagram_lines(event.diagram, ascii=True):
            self._line(f"   {line}".rstrip())

    @_tell.register
    def _(self, event: Trouble) -> None:
        self._line(f"!! {event.reason}")
        self._line(f"   What to do: {event.remedy}.")

    @_tell.register
    def _(self, event: Result) -> None:
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

    @_tell.register
    def _(self, event: RunEnded) -> None:
        self._line("")
        self._line(NOTHING if event.empty else ENDS[event.how])
        if event.report is not None:
            self._line(f"Report: {event.report}")
        if event.certificate is not None:
            self._line(f"Certificate: {event.certificate}")

    def say_stopped(self) -> None:
        """Every device was told to stop: said at once, whatever the run is at; from any thread."""
        with suppress(OSError, ValueError):
            self._write.write("\n" + STOPPING + "\n")
            self._write.flush()

    # --- what is asked

    def answer(self, ask: Ask) -> Fact:
        """The answer from the next lines of stdin. Raises Stopped at its end, or when the operator stops."""
        while True:
            self._shown = ""
            line = self._answer_line(question_line(self._shortened(ask)))
            if not line or line.strip().lower() in STOPS:
                self._line("" if line else "(end of input)")
                raise Stopped
            try:
                return parse(ask, line)
            except ValueError as error:
                self._line(f"   {error}")

    def _answer_line(self, question: str) -> str:
        """What stands on the next line of stdin, "" at its end."""
        self.asking = True
        try:
            with suppress(OSError):
                self._write.write(question)
                self._write.flush()
            line = self._read.readline()
        finally:
            self.asking = False
        if not self._read.isatty():  # where nobody typed, the answer is written down
            self._write.write(line.rstrip("\n") + "\n")
        return line

    def _shortened(self, ask: Ask) -> Ask:
        """The question without what was just advised in the same words."""
        if self._advised and ask.question.startswith(self._advised):
            return replace(ask, question=("Do that." + ask.question.removeprefix(self._advised)))
        return ask


def question_line(ask: Ask) -> str:
    """The question with its choices and default, ready for the answer on the same line."""
    if ask.key == MOVE:
        return f">> {ask.question} Clear? [Enter moves; n: not; Ctrl-C stops everything] "
    choices = f" ({', '.join(f'{i} {choice}' for i, choice in enumerate(ask.choices, 1))})" if ask.choices else ""
    if ask.kind == "confirm":
        return f">> {ask.question} [Enter when done] "
    unit = f" in {ask.unit}" if ask.unit and ask.default is None else ""
    default = f" [{words(ask.default, ask.unit)}]" if ask.default is not None else ""
    return f">> {ask.question}{unit}{choices}{default} "


def seen_lines(advice: Advice) -> list[str]:
    """What a look found: the numbers with their tolerance, then what to do."""
    numbers = [reading_words(reading) for reading in advice.readings]
    return [f"   {'; '.join(numbers)}"] * bool(numbers) + [f"   {'ok' if advice.good else '->'} {advice.say}"]


def plane_words(plane: PlaneResult) -> str:
    """A plane's verdict and its MTF50 along rows and columns: "G1 pass: MTF50 0.412 ± 0.003 by 0.408 ± 0.003"."""
    told = [plane.numbers[key] for key in (MTF50_HORIZONTAL, MTF50_VERTICAL) if key in plane.numbers]
    if not told:
        return f"{plane.name} {measurement_words(plane.verdict)}"
    both = " by ".join(stated(one.value, one.uncertainty) for one in told)
    return f"{plane.name} {measurement_words(plane.verdict)}: MTF50 {both} {told[0].unit}"


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
    """A number as it is read aloud, with as many digits as its unit asks for: 2.6°, 72 %, 1.55 m."""
    digits = f"{value:z.{DIGITS[unit]}f}" if unit in DIGITS else f"{value:.3g}"
    return digits + unit if unit == "°" else f"{digits} {unit}".strip()


def curve_line(event: CurveSeen) -> str:
    """The last place of a scan and a bar as long as its score."""
    score = event.scores[-1]
    told = f"{score:.3f}" if score == score else "cannot be told"
    bar = "#" * round(40 * min(max(score, 0.0), 1.0)) if score == score else ""
    return f"{event.axis.replace('_', ' ')} {event.places[-1]:8.2f}: {told:>6} {bar}"
