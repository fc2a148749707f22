"""The guide as plain lines: what happens on stdout, answers from stdin. Works with pipes, and for screen readers."""

from __future__ import annotations

from dataclasses import replace
from functools import singledispatchmethod
from io import StringIO
from typing import TextIO

from procedures.plan import Advice, Ask, Fact, Reading
from station.answers import parse, words
from station.operator import (
    CurveSeen,
    Doing,
    Event,
    Result,
    RunBegan,
    RunEnded,
    Seen,
    StepBegan,
    StepEnded,
    Stopped,
    Trouble,
)

STOPS = ("s", "stop", "q", "quit")
HELP = "Enter answers with what stands in [brackets]; s stops; Ctrl-C stops after this exposure, twice at once."
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
        self._line(f"-- {event.step.title}: done")

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
        for line in seen_lines(event.advice):
            self._line(line)

    @_tell.register
    def _(self, event: CurveSeen) -> None:
        self._line(f"   {curve_line(event)}")

    @_tell.register
    def _(self, event: Trouble) -> None:
        self._line(f"!! {event.reason}")
        self._line(f"   What to do: {event.remedy}.")

    @_tell.register
    def _(self, event: Result) -> None:
        self._line(f"   Result: {event.verdict}. " + ", ".join(f"{n} {v}" for n, v in event.verdicts.items()))
        if event.reason:
            self._line(f"   Why: {event.reason}.")
            self._line(f"   What to do: {event.remedy}.")
        self._line(f"   Files: {event.folder}")

    @_tell.register
    def _(self, event: RunEnded) -> None:
        self._line("")
        self._line(ENDS[event.how])
        if event.report is not None:
            self._line(f"Report: {event.report}")

    # --- what is asked

    def answer(self, ask: Ask) -> Fact:
        """The answer from the next lines of stdin. Raises Stopped at its end, or when the operator stops."""
        while True:
            self._shown = ""
            self._write.write(question_line(self._shortened(ask)))
            self._write.flush()
            line = self._read.readline()
            if not line or line.strip().lower() in STOPS:
                self._line("" if line else "(end of input)")
                raise Stopped
            try:
                return parse(ask, line)
            except ValueError as error:
                self._line(f"   {error}")

    def _shortened(self, ask: Ask) -> Ask:
        """The question without what was just advised in the same words."""
        if self._advised and ask.question.startswith(self._advised):
            return replace(ask, question=("Tell when it is done." + ask.question.removeprefix(self._advised)))
        return ask


def question_line(ask: Ask) -> str:
    """The question with its choices and default, ready for the answer on the same line."""
    choices = f" ({', '.join(f'{i} {choice}' for i, choice in enumerate(ask.choices, 1))})" if ask.choices else ""
    if ask.kind == "confirm":
        return f">> {ask.question} [Enter] "
    unit = f" in {ask.unit}" if ask.unit and ask.default is None else ""
    default = f" [{words(ask.default, ask.unit)}]" if ask.default is not None else ""
    return f">> {ask.question}{unit}{choices}{default} "


def seen_lines(advice: Advice) -> list[str]:
    """What a look found: the numbers with their tolerance, then what to do."""
    numbers = [reading_words(reading) for reading in advice.readings]
    return [f"   {'; '.join(numbers)}"] * bool(numbers) + [f"   {'ok' if advice.good else '->'} {advice.say}"]


def reading_words(reading: Reading) -> str:
    """A number with its unit, and its tolerance where it is outside: "white 31 % (55 to 90 %)"."""
    unit = f" {reading.unit}" if reading.unit and reading.unit != "°" else reading.unit
    value = f"{reading.name} {reading.value:.3g}{unit}"
    if reading.good:
        return value
    match reading.low, reading.high:
        case (None, high):
            return f"{value} (at most {high:g}{unit})"
        case (low, None):
            return f"{value} (at least {low:g}{unit})"
        case (low, high):
            return f"{value} ({low:g} to {high:g}{unit})"


def curve_line(event: CurveSeen) -> str:
    """The last place of a scan and a bar as long as its score."""
    best = max((score for score in event.scores if score == score), default=0.0)
    score = event.scores[-1]
    told = f"{score:.3f}" if score == score else "cannot be told"
    bar = "#" * round(30 * score / best) if score == score and best > 0 else ""
    return f"{event.axis.replace('_', ' ')} {event.places[-1]:8.2f}: {told:>6} {bar}"
