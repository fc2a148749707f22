"""Live focus: sharpness of every new photograph, the best so far, and which way to turn the ring."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal
from textual.message import Message

from procedures.drawings import steps as drawings
from procedures.pattern import BEST_S_OVER_T, Chart
from procedures.pattern_psf.checks import marks_of
from procedures.pattern_psf.focus.sweep import TurnDirection
from procedures.plan import Ask
from station.app.background import Finished
from station.app.commands import FOCUS, Command, EndFocus, EndRun, TurnFar, TurnNear, bindings
from station.app.screens.parts import AnswerBox, StationScreen
from station.app.terminal_images import Thumbnail, thumbnail
from station.app.widgets import BigText, CurveView, Part, Picture, lines_of, literal
from station.common.sanitise import stated
from station.drawing.diagrams import trend
from station.guide.focus.live import LiveFocus, LiveFrame, PhotographSource
from station.guide.frontend import MOVE

if TYPE_CHECKING:
    from station.bench.opening import Bench
    from station.guide.focus.live import FocusReading

SIMULATED, CAMERA, FOLDER = "the simulated camera", "the bench's camera", "a folder"
WORDS = {
    SIMULATED: "the simulated camera; the arrow keys turn its ring",
    CAMERA: "the bench's camera, with repeated exposures",
    FOLDER: "a folder in which photographs arrive",
}
SOURCE = "Live focus. Where do the photographs of the chart come from?"
NAMED = Ask("folder", "Folder in which the photographs arrive?", "text")
HOMES = Ask(MOVE, "The simulated stages home, each axis to its switch, then move to the middle of their travel.")
SIGNS = {TurnDirection.TRY: "?", TurnDirection.ON: ">", TurnDirection.BACK: "<", TurnDirection.STAY: "="}
"""Sign after the number: continue, turn back, stay."""
FrameSource = Callable[[PhotographSource], Iterator[LiveFrame]]


class FocusScreen(StationScreen):
    """Sharpness of successive photographs."""

    COMMANDS_HERE = FOCUS
    BINDINGS: ClassVar[list[BindingType]] = bindings(FOCUS)

    class Measured(Message):
        """A photograph was measured; posted from the thread."""

        def __init__(self, reading: FocusReading, picture: Thumbnail | None) -> None:
            super().__init__()
            self.reading, self.picture = reading, picture

    def __init__(self) -> None:
        super().__init__()
        self._sources: Sequence[str] = ()
        self._source = ""
        self._measuring = False
        self._ended = threading.Event()
        self._turns: queue.Queue[float | None] = queue.Queue()

    def body(self) -> ComposeResult:
        """Source, instruction, the number with its sign, further numbers, trend and image."""
        yield Part(id="source")
        yield AnswerBox(id="answer")
        with Horizontal(id="reading"):
            yield BigText(id="big")
            yield Part(id="numbers")
        with Horizontal(id="sight"):
            yield CurveView(id="curve")
            yield Picture(drawings.FOCUS, id="picture")

    def on_mount(self) -> None:
        super().on_mount()
        self._ask_source()

    def on_unmount(self) -> None:
        self._end()

    def refresh_frame(self) -> None:
        super().refresh_frame()
        if self.is_mounted and not self._measuring and not self._source and self._sources != self._available_sources():
            self._ask_source()

    def can(self, command: type[Command]) -> bool:
        if command is EndFocus:
            return bool(self._source)
        return self._measuring and self._source == SIMULATED

    def _available_sources(self) -> Sequence[str]:
        if self.bench is None or "camera" not in self.bench.devices:
            return (FOLDER,)
        return (SIMULATED if self.bench.surroundings.hands is not None else CAMERA, FOLDER)

    def _ask_source(self) -> None:
        self._sources, self._source = self._available_sources(), ""
        self.query_one("#source", Part).update(literal("No measurement yet."))
        choices = tuple(WORDS[name] for name in self._sources)
        self.query_one(AnswerBox).ask(Ask("source", SOURCE, "choice", choices=choices))
        self.query_one("#reading").display = False
        self.query_one(CurveView).display = False
        self.query_one(Picture).display = True
        self.query_one(Picture).show(None)

    @on(AnswerBox.Given)
    def _given(self, message: AnswerBox.Given) -> None:
        message.stop()
        answers = self.query_one(AnswerBox)
        if not self._source:
            self._source = next(name for name in self._sources if WORDS[name] == message.fact)
            if self._source == CAMERA:
                self._begin(lambda source: source.tethered(self._required_bench()))
            else:
                answers.ask(NAMED if self._source == FOLDER else HOMES)
        elif self._source == FOLDER:
            folder = Path(str(message.fact)).expanduser()
            self._begin(lambda source: source.watched(folder, self._ended.wait))
        else:
            self._begin(lambda source: source.simulated(self._required_bench(), self._places()))
        self.refresh_frame()

    def _required_bench(self) -> Bench:
        assert self.bench is not None  # such sources are offered only with a bench
        return self.bench

    def _places(self) -> Iterator[float]:
        """Settings of the simulated ring as its keys are pressed; ends with the measurement."""
        place = 0.0
        while True:
            yield place
            turn = self._turns.get()
            if turn is None:
                return
            place += turn

    def _begin(self, source: FrameSource) -> None:
        self._ended, self._turns = threading.Event(), queue.Queue()
        app, on_bench = self.app, self._source != FOLDER
        if on_bench and (busy := app.bench_taken):  # type: ignore[attr-defined]
            self._end_with(busy)
            return
        self._measuring = True
        self.query_one("#source", Part).update(literal(f"Photographs come from {self._source}."))
        self.query_one(AnswerBox).show_sentence(
            "Waiting for the first photograph." if on_bench else "Take a photograph."
        )
        frames = source(PhotographSource(self._ended.is_set))
        app.focus(partial(self._work, frames), self._end, on_bench=on_bench)  # type: ignore[attr-defined]

    def _work(self, frames: Iterator[LiveFrame]) -> None:
        """Measure the photographs; in a thread."""
        live = LiveFocus(Chart.from_seed())
        for frame in frames:
            reading = live.measure(frame)
            with suppress(RuntimeError):  # the loop is closed
                self.post_message(self.Measured(reading, _preview(reading)))

    def _end(self) -> None:
        """End the measurement; from any thread."""
        self._ended.set()
        self._turns.put(None)

    @on(TurnNear)
    @on(TurnFar)
    def turn(self, message: Command) -> None:
        self._turns.put(1.0 if isinstance(message, TurnFar) else -1.0)

    @on(EndRun)
    @on(EndFocus)
    def end_focus(self, message: Message) -> None:
        if self._measuring:
            message.stop()
            self._end()
            self.query_one(AnswerBox).show_sentence("Ending after this photograph.")
        elif isinstance(message, EndFocus):
            self._ask_source()
            self.refresh_frame()

    def done(self, finished: Finished) -> None:
        if finished.job.name == "focus":
            problem = finished.problem
            self._end_with(f"{problem.reason}. {problem.remedy}." if problem is not None else "Ended.")

    def _end_with(self, words: str) -> None:
        self._measuring = False
        self._ask_source()
        self.query_one("#source", Part).update(literal(words, "bold"))
        self.refresh_frame()

    @on(Measured)
    def _measured(self, message: Measured) -> None:
        reading = message.reading
        self.query_one("#reading").display = self.query_one(CurveView).display = True
        self.query_one("#source", Part).update(literal(_took(reading)))
        sharpness = reading.sharpness.value
        why = f"This photograph cannot be measured: {reading.sharpness.reason}. What to do: {reading.sharpness.remedy}."
        self.query_one(AnswerBox).show_sentence(reading.say if sharpness is not None else why)
        self.query_one(BigText).show(
            f"{sharpness.mtf50.value:.3f}{SIGNS[reading.way]}" if sharpness is not None else "-.---?"
        )
        glyphs = self.query_one(BigText).glyphs
        self.query_one("#numbers", Part).update(lines_of(*(glyphs.spelt(line) for line in numbers_of(reading))))
        known = all(place == place for place in reading.places)
        places = reading.places if known else tuple(range(1, reading.number + 1))
        best = None if reading.best is None else reading.scores[reading.best - 1]
        over = "steps of the ring" if known else "photographs"
        self.query_one(CurveView).show(trend(places, reading.scores, f"MTF50 in cycles/pixel over {over}", best))
        self.query_one(Picture).display = self.app.size.width >= WIDE
        self.query_one(Picture).show(message.picture)
        if sharpness is not None and reading.best == reading.number:
            self.query_one(BigText).add_class("-best")
        else:
            self.query_one(BigText).remove_class("-best")


WIDE = 110
"""Columns from which the photograph is shown next to the trend."""


def _preview(reading: FocusReading) -> Thumbnail | None:
    plane, sharpness = reading.frame.plane.value, reading.sharpness.value
    return None if plane is None else thumbnail(plane, () if sharpness is None else marks_of(sharpness.sighting))


def _took(reading: FocusReading) -> str:
    return f"Photograph {reading.number}, {reading.frame.path.name}: measured {reading.took_s:.2f} s after its arrival."


def numbers_of(reading: FocusReading) -> list[str]:
    """Numbers of one photograph, and the best so far."""
    sharpness, lines = reading.sharpness.value, []
    if sharpness is not None:
        lines = [
            f"MTF50 {stated(sharpness.mtf50.value, sharpness.mtf50.uncertainty)}",
            "cycles/pixel of the plane",
            f"rows {sharpness.along_rows.value:.3f}, columns {sharpness.along_columns.value:.3f}",
            f"astigmatism {stated(*sharpness.astigmatism)}",
            "s/t {:.2f} (best: {:g} to {:g})".format(sharpness.s_over_t, *BEST_S_OVER_T),
        ]
    if reading.best is not None:
        lines.append(f"best {reading.scores[reading.best - 1]:.3f}, photograph {reading.best}")
    if reading.peak is not None:
        beyond = "" if reading.peak.inside else ", outside the range tried"
        lines.append(f"maximum at {stated(reading.peak.place, reading.peak.place_uncertainty)} steps{beyond}")
    return lines
