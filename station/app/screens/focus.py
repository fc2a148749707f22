"""Live focus: how sharp every photograph is that comes, the best so far, and which way to turn the ring."""

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
from station.common.uncertainty_text import stated
from station.drawing.diagrams import trend
from station.guide.focus.live import LiveFocus, LiveFrame, PhotographSource
from station.guide.frontend import MOVE

if TYPE_CHECKING:
    from station.bench.opening import Bench
    from station.guide.focus.live import FocusSeen

SIMULATED, CAMERA, FOLDER = "the simulated camera", "the bench's camera", "a folder"
WORDS = {
    SIMULATED: "the simulated camera, whose ring the arrow keys turn",
    CAMERA: "the bench's camera, one exposure after the other",
    FOLDER: "a folder in which photographs arrive",
}
WHENCE = "Live focus. Where do the photographs of the chart come from?"
NAMED = Ask("folder", "In which folder do they arrive?", "text")
HOMES = Ask(MOVE, "The simulated stages home, each axis to its switch, then go to the middle of their travel.")
SIGNS = {TurnDirection.TRY: "?", TurnDirection.ON: ">", TurnDirection.BACK: "<", TurnDirection.STAY: "="}
"""Beside the number: go on, turn back, stay."""
Coming = Callable[[PhotographSource], Iterator[LiveFrame]]


class FocusScreen(StationScreen):
    """One photograph after the other."""

    COMMANDS_HERE = FOCUS
    BINDINGS: ClassVar[list[BindingType]] = bindings(FOCUS)

    class Measured(Message):
        """A photograph was measured; in the thread."""

        def __init__(self, seen: FocusSeen, picture: Thumbnail | None) -> None:
            super().__init__()
            self.seen, self.picture = seen, picture

    def __init__(self) -> None:
        super().__init__()
        self._offers: Sequence[str] = ()
        self._from = ""
        self._at_work = False
        self._ended = threading.Event()
        self._turns: queue.Queue[float | None] = queue.Queue()

    def body(self) -> ComposeResult:
        """What to do, the number with its sign, what else is known, the trend, the picture."""
        yield Part(id="source")
        yield AnswerBox(id="answer")
        with Horizontal(id="told"):
            yield BigText(id="big")
            yield Part(id="numbers")
        with Horizontal(id="sight"):
            yield CurveView(id="curve")
            yield Picture(drawings.FOCUS, id="picture")

    def on_mount(self) -> None:
        """Ask where photographs come from."""
        super().on_mount()
        self._ask_whence()

    def on_unmount(self) -> None:
        """Nothing goes on behind a closed screen."""
        self._end()

    def refresh_frame(self) -> None:
        """The bench may have been opened meanwhile."""
        super().refresh_frame()
        if self.is_mounted and not self._at_work and not self._from and self._offers != self._offered():
            self._ask_whence()

    def can(self, command: type[Command]) -> bool:
        """The ring turns where it is simulated."""
        if command is EndFocus:
            return bool(self._from)
        return self._at_work and self._from == SIMULATED

    # --- where photographs come from

    @property
    def bench(self) -> Bench | None:
        """The application's."""
        found: Bench | None = self.app.bench  # type: ignore[attr-defined]
        return found

    def _offered(self) -> Sequence[str]:
        if self.bench is None or "camera" not in self.bench.devices:
            return (FOLDER,)
        return (SIMULATED if self.bench.surroundings.hands is not None else CAMERA, FOLDER)

    def _ask_whence(self) -> None:
        self._offers, self._from = self._offered(), ""
        self.query_one("#source", Part).update(literal("Nothing is measured yet."))
        choices = tuple(WORDS[one] for one in self._offers)
        self.query_one(AnswerBox).ask(Ask("whence", WHENCE, "choice", choices=choices))
        self.query_one("#told").display = False
        self.query_one(CurveView).display = False
        self.query_one(Picture).display = True
        self.query_one(Picture).show(None)

    @on(AnswerBox.Given)
    def _given(self, message: AnswerBox.Given) -> None:
        message.stop()
        answers = self.query_one(AnswerBox)
        if not self._from:
            self._from = next(one for one in self._offers if WORDS[one] == message.fact)
            if self._from == CAMERA:
                self._begin(lambda source: source.tethered(self._bench_there()))
            else:
                answers.ask(NAMED if self._from == FOLDER else HOMES)
        elif self._from == FOLDER:
            folder = Path(str(message.fact)).expanduser()
            self._begin(lambda source: source.watched(folder, self._ended.wait))
        else:
            self._begin(lambda source: source.simulated(self._bench_there(), self._places()))
        self.refresh_frame()

    def _bench_there(self) -> Bench:
        assert self.bench is not None  # what needs it is offered where it is
        return self.bench

    def _places(self) -> Iterator[float]:
        """Where the simulated ring is turned to, as its keys are pressed; ends with the work."""
        place = 0.0
        while True:
            yield place
            turn = self._turns.get()
            if turn is None:
                return
            place += turn

    # --- at work

    def _begin(self, coming: Coming) -> None:
        self._ended, self._turns = threading.Event(), queue.Queue()
        app, on_bench = self.app, self._from != FOLDER
        if on_bench and (taken := app.bench_taken):  # type: ignore[attr-defined]
            self._broke_off(taken)
            return
        self._at_work = True
        self.query_one("#source", Part).update(literal(f"Photographs come from {self._from}."))
        self.query_one(AnswerBox).tell("Waiting for the first photograph." if on_bench else "Take a photograph.")
        frames = coming(PhotographSource(self._ended.is_set))
        app.focus(partial(self._work, frames), self._end, on_bench=on_bench)  # type: ignore[attr-defined]

    def _work(self, frames: Iterator[LiveFrame]) -> None:
        """Measure what comes; in a thread."""
        live = LiveFocus(Chart.from_seed())
        for frame in frames:
            seen = live.see(frame)
            with suppress(RuntimeError):  # the loop is closed: nobody is there to see
                self.post_message(self.Measured(seen, _glimpse(seen)))

    def _end(self) -> None:
        """Measure no more; from any thread."""
        self._ended.set()
        self._turns.put(None)

    @on(TurnNear)
    def turn_near(self) -> None:
        """One step."""
        self._turns.put(-1.0)

    @on(TurnFar)
    def turn_far(self) -> None:
        """One step."""
        self._turns.put(1.0)

    @on(EndRun)
    @on(EndFocus)
    def end_focus(self, message: Message) -> None:
        """End it, or go back to the question before."""
        if self._at_work:
            message.stop()
            self._end()
            self.query_one(AnswerBox).tell("Ending after this photograph.")
        elif isinstance(message, EndFocus):
            self._ask_whence()
            self.refresh_frame()

    def done(self, finished: Finished) -> None:
        """The work has ended."""
        if finished.job.name == "focus":
            problem = finished.problem
            self._broke_off(f"{problem.reason}. {problem.remedy}." if problem is not None else "Ended.")

    def _broke_off(self, words: str) -> None:
        self._at_work = False
        self._ask_whence()
        self.query_one("#source", Part).update(literal(words, "bold"))
        self.refresh_frame()

    # --- what is shown

    @on(Measured)
    def _measured(self, message: Measured) -> None:
        seen = message.seen
        self.query_one("#told").display = self.query_one(CurveView).display = True
        self.query_one("#source", Part).update(literal(_took(seen)))
        found = seen.found.value
        why = f"This photograph tells nothing: {seen.found.reason}. What to do: {seen.found.remedy}."
        self.query_one(AnswerBox).tell(seen.say if found is not None else why)
        self.query_one(BigText).show(f"{found.mtf50.value:.3f}{SIGNS[seen.way]}" if found is not None else "-.---?")
        glyphs = self.query_one(BigText).glyphs
        self.query_one("#numbers", Part).update(lines_of(*(glyphs.spelt(line) for line in numbers_of(seen))))
        self.query_one(CurveView).show(_curve(seen))
        self.query_one(Picture).display = self.app.size.width >= WIDE
        self.query_one(Picture).show(message.picture)
        if found is not None and seen.best == seen.number:
            self.query_one(BigText).add_class("-best")
        else:
            self.query_one(BigText).remove_class("-best")


WIDE = 110
"""Columns from which on the photograph is shown beside the trend."""


def _glimpse(seen: FocusSeen) -> Thumbnail | None:
    """The photograph with the chart's marks."""
    if seen.frame.plane.value is None:
        return None
    return thumbnail(seen.frame.plane.value, () if seen.found.value is None else marks_of(seen.found.value.sighting))


def _took(seen: FocusSeen) -> str:
    return f"Photograph {seen.number}, {seen.frame.path.name}: measured {seen.took_s:.2f} s after it came."


def numbers_of(seen: FocusSeen) -> list[str]:
    """What one photograph gave, and the best so far."""
    found, lines = seen.found.value, []
    if found is not None:
        lines = [
            f"MTF50 {stated(found.mtf50.value, found.mtf50.uncertainty)}",
            "cycles/pixel of the plane",
            f"rows {found.along_rows.value:.3f}, columns {found.along_columns.value:.3f}",
            f"astigmatism {stated(*found.astigmatism)}",
            "s/t {:.2f} (best: {:g} to {:g})".format(found.s_over_t, *BEST_S_OVER_T),
        ]
    if seen.best is not None:
        lines.append(f"best {seen.scores[seen.best - 1]:.3f}, photograph {seen.best}")
    if seen.peak is not None:
        beyond = "" if seen.peak.inside else ", beyond what was tried"
        lines.append(f"top at {stated(seen.peak.place, seen.peak.place_uncertainty)} steps{beyond}")
    return lines


def _curve(seen: FocusSeen) -> Callable[[int, int, bool], list[str]]:
    """The scores over the settings where they are known, else in the order of the photographs."""
    known = all(place == place for place in seen.places)
    places = seen.places if known else tuple(range(1, seen.number + 1))
    best = None if seen.best is None else seen.scores[seen.best - 1]
    return trend(places, seen.scores, f"MTF50 over {'steps of the ring' if known else 'photographs'}", best)
