"""The guide: list of steps, instruction, next action, image and live numbers."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial, singledispatchmethod
from math import ceil
from typing import TYPE_CHECKING, ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.events import Key

from station.app.commands import GUIDE, Command, EndRun, GoOn, NewSession, ShowResults, StepBack, bindings
from station.app.mailbox import FramePreview, MailboxEntry, Question
from station.app.screens.parts import AnswerBox, StationScreen
from station.app.screens.result_view import mtf_plot, number_lines, specified
from station.app.terminal_images import picture_thumbnail, psf_thumbnail
from station.app.widgets import (
    BigText,
    CurveView,
    Part,
    Picture,
    ProgressLine,
    Rail,
    Readings,
    lines_of,
    literal,
    verdict_words,
)
from station.bench.axis_text import axis_words
from station.drawing.diagrams import drawn, trend
from station.guide import frontend
from station.guide.coach import DOWN, LEFT, RIGHT, UP, way_words, ways
from station.guide.line_frontend import plane_words

if TYPE_CHECKING:
    from procedures.plan import Reading
    from station.app.background import Problem
    from station.app.screens.result_view import Plotted
    from station.drawing.glyphs import Glyphs
    from station.results.plane_result import PlaneResult

COUNT_S = 0.5
SIGNS = {RIGHT: ">", LEFT: "<", DOWN: "v", UP: "^"}
"""Large signs of the ways."""
AT_WORK = "Please wait: the station is working."
ENDINGS = {
    "finished": "Done.",
    "stopped": "The run was ended. All photographs are kept.",
    "emergency": "Every device was stopped. Check the bench first. Continuing homes the stages.",
}
AFTER_THE_END: dict[str, type[Command]] = {"show the results": ShowResults, "new session": NewSession}
AFTER_A_STOP: dict[str, type[Command]] = {"continue where it stopped": GoOn, "new session": NewSession}


class GuideScreen(StationScreen):
    """One step at a time."""

    AUTO_FOCUS = ""  # the question takes the focus
    COMMANDS_HERE = GUIDE
    BINDINGS: ClassVar[list[BindingType]] = bindings(GUIDE)

    def __init__(self) -> None:
        super().__init__()
        self._began: frontend.RunBegan | None = None
        self._done: dict[str, str] = {}
        self._now: str | None = None
        self._stopped = False
        self._doing_last = False
        self._verdict: tuple[str, ...] = ()
        self._coached: FramePreview | None = None
        self._held_until_s = 0.0

    def on_mount(self) -> None:
        """Count the time down for which a pose must be held; Textual calls the base class's handler itself."""
        for name in ("#coach", "#goal", "#values"):
            self.query_one(name, Part).say("")
        self.query_one("#sign").display = False
        self.set_interval(COUNT_S, self._show_coach)

    def body(self) -> ComposeResult:
        with Horizontal(id="middle"):
            yield Rail(id="rail")
            with Vertical(id="main"):
                yield Part(id="instruction")
                yield AnswerBox(id="answer")
                yield Part(id="coach")
                with Horizontal(id="sight"):
                    yield Picture("no photograph yet", id="picture")
                    with VerticalScroll(id="numbers", can_focus=False):
                        yield BigText(id="sign")
                        yield Part(id="values")
                        yield Readings(id="readings")
                        yield CurveView(id="curve")
        yield Part(id="trouble")
        yield Part(id="goal")
        yield ProgressLine(id="progress")

    @property
    def whole(self) -> bool:
        """Whether its widgets exist; false while the screens are being removed."""
        return bool(self.query(ProgressLine))

    @property
    def answers(self) -> AnswerBox:
        return self.query_one(AnswerBox)

    def can(self, command: type[Command]) -> bool:
        """Continue only after a stop, step back only after a completed step."""
        if command is GoOn:
            return self._stopped and not self.finished
        if command is StepBack:
            return self.step_before is not None
        return command is not NewSession or self._stopped

    def question_help(self) -> Sequence[str]:
        steps = self._began.plan.steps if self._began is not None else ()
        return self.answers.explain(next((step for step in steps if step.name == self._now), None))

    @property
    def finished(self) -> bool:
        return self._began is not None and len(self._done) == len(self._began.plan.steps)

    @property
    def step_before(self) -> str | None:
        """The step completed last."""
        return next(reversed(self._done), None)

    def on_key(self, event: Key) -> None:
        if self.whole:
            self.answers.type_ahead(event)

    @singledispatchmethod
    def show(self, entry: MailboxEntry) -> None:
        raise TypeError(f"unknown event: {entry!r}")

    @show.register
    def _(self, began: frontend.RunBegan) -> None:
        self._began, self._now, self._stopped = began, None, False
        self._done = {name: began.gave.get(name, "") for name in began.done}
        self.query_one("#trouble", Part).say("")
        self._show_rail()

    @show.register
    def _(self, began: frontend.StepBegan) -> None:
        self._now = began.step.name
        steps = [step.name for step in self._began.plan.steps] if self._began is not None else []
        before = steps[: steps.index(began.step.name)] if began.step.name in steps else steps
        self._done = {step: gave for step, gave in self._done.items() if step in before}
        self._end_coach()
        for name in ("#trouble", "#goal"):
            self.query_one(name, Part).say("")
        words = (literal(began.step.title, "bold"), began.step.instruction)
        self.query_one("#instruction", Part).update(lines_of(*words, *self._verdict))
        if not self._verdict:
            self._show_readings(())
            self._show_curve(None)
            self._show_values(())
            if began.step.drawing:
                self.query_one(Picture).show_words(began.step.drawing)
        self._show_rail()

    @show.register
    def _(self, ended: frontend.StepEnded) -> None:
        self._now = None
        self._done.pop(ended.step.name, None)  # to the end
        self._done[ended.step.name] = ended.gave
        self._show_rail()

    @show.register
    def _(self, doing: frontend.ProgressEvent) -> None:
        self.query_one(ProgressLine).show(doing)
        self._doing_last = doing.lasts
        if not self.answers.open:
            self.answers.show_sentence(AT_WORK)

    @show.register
    def _(self, preview: FramePreview) -> None:
        self._doing_last = False
        self._end_verdict()
        was_held = self._coached is not None and self._coached.hold_s is not None
        outline = preview.advice.outline
        self._coached = (
            preview if outline is not None and not (preview.advice.good and preview.hold_s is None) else None
        )
        if preview.hold_s is not None:
            self._held_until_s = time.monotonic() + preview.hold_s
            if not was_held:
                self.app.bell()
        self._show_coach()
        self.query_one(Picture).show(preview.picture)
        self._show_readings(preview.advice.readings)
        if not self.answers.open:
            self.answers.show_sentence(AT_WORK if preview.hold_s is not None else preview.advice.say or AT_WORK)

    @show.register
    def _(self, event: frontend.GoalEvent) -> None:
        self.query_one("#goal", Part).say(self.glyphs.spelt(event.goal.say))

    @show.register
    def _(self, matched: frontend.Matched) -> None:
        self.app.bell()
        self._end_coach()
        self.answers.show_sentence("Taking the photograph.")

    @show.register
    def _(self, curve: frontend.ScanEvent) -> None:
        self._show_curve(trend(curve.places, curve.scores, f"{curve.quantity} over {axis_words(curve.axis)}"))

    @show.register
    def _(self, event: frontend.DiagramEvent) -> None:
        steps = self._began.plan.steps if self._began is not None else ()
        title = [literal(step.title, "bold") for step in steps if step.name == self._now]
        self.query_one("#instruction", Part).update(lines_of(*title, event.diagram.say))
        if event.diagram.drawing:
            self._end_verdict()
            self.query_one(Picture).show_words(event.diagram.drawing)
        self._show_curve(None if event.diagram.drawing else partial(drawn, event.diagram))

    @show.register
    def _(self, problem: frontend.ProblemEvent) -> None:
        self._doing_last = False
        self._complain(problem.reason, problem.remedy)

    @show.register
    def _(self, result: frontend.Result) -> None:
        self._doing_last = False
        planes = [f"{name}: {verdict_words(plane.verdict, self.glyphs)}" for name, plane in result.planes.items()]
        words = [f"Measurement: {verdict_words(result.verdict, self.glyphs)}   {'   '.join(planes)}"]
        lens, *against = specified(list(result.planes.values())) or [""]
        others = "; ".join(cause.reason for cause in result.other_causes)
        words += [lens, sentences(result.reason, result.remedy), *against]
        words += [f"Other possible causes: {others}."] if others else []
        self._verdict = tuple(text for text in words if text)
        self.add_class("-verdict")
        self.query_one("#instruction", Part).update(lines_of(literal("Result", "bold"), *self._verdict))
        self._show_readings(())
        self._show_values(list(result.planes.values()))
        self._show_sharpness(result)

    @show.register
    def _(self, question: Question) -> None:
        progress = self.query_one(ProgressLine)
        if self._doing_last and question.ask.key != frontend.MOVE:  # a note for this question
            progress.hold()
        else:
            progress.show(None)
        self.answers.ask(question.ask)
        self._doing_last = False

    @show.register
    def _(self, ended: frontend.RunEnded) -> None:
        report = f" The report is {ended.report}." if ended.report else ""
        report += f" The certificate is {ended.certificate.name} in the same folder." if ended.certificate else ""
        finished = ended.how == "finished"
        self.rest(ENDINGS.get(ended.how, "The run has ended.") + report, AFTER_THE_END if finished else AFTER_A_STOP)
        if finished:
            self.app.bell()

    def fail(self, problem: Problem) -> None:
        self._complain(problem.reason, problem.remedy)
        self.rest("The run failed. All photographs are kept.", AFTER_A_STOP)

    def rest(self, sentence: str, offers: Mapping[str, type[Command]]) -> None:
        self._now, self._stopped = None, True
        self.query_one(ProgressLine).show(None)
        self.answers.offer(sentence, offers)
        self._show_rail()
        self.refresh_frame()

    def begin(self, words: str) -> None:
        self._stopped = False
        self.query_one("#trouble", Part).say("")
        self.answers.show_sentence(words)
        self.refresh_frame()

    def ending(self) -> None:
        self.answers.show_sentence(
            f"Ending after this exposure. {EndRun.key_name()} again: stop every device and end now."
        )

    def _end_coach(self) -> None:
        self._coached = None
        self._show_coach()

    def _show_coach(self) -> None:
        """The way to the wanted outline, or the countdown, in words and in large signs."""
        if not self.whole:
            return
        words = sign = ""
        if self._coached is not None and self._coached.hold_s is not None:
            left = max(ceil(self._held_until_s - time.monotonic()), 0)
            words, sign = f"Hold still: {left} s", str(left)
        elif self._coached is not None and (outline := self._coached.picture.outline) is not None:
            words = way_words(outline, (1, 1)) if outline.present else ""
            sign = " ".join(SIGNS[arrow] for arrow, _ in ways(outline, (1, 1))) if outline.present else ""
            words = words and f"To its place: {self.glyphs.spelt(words)}"
        self.query_one("#coach", Part).say(words, "bold")
        big = self.query_one("#sign", BigText)
        if big.text != sign:
            big.display = bool(sign)
            big.show(sign)
            self._make_room()

    def _end_verdict(self) -> None:
        self._verdict = ()
        self.remove_class("-verdict")
        self._show_values(())

    def _show_sharpness(self, result: frontend.Result) -> None:
        """PSF and MTF of the plane whose numbers are shown, or the restored picture."""
        from procedures.outcome import ProcedureError  # imported here: the first screen needs neither
        from station.results.reader import read_picture

        one = min(result.planes.values(), key=lambda plane: plane.name != "G1", default=None)
        if one is not None and one.samples is not None:
            self.query_one(Picture).show(psf_thumbnail(one.samples, f"PSF of plane {one.name}"))
        elif (restored := result.folder / "sharp.png").is_file():
            with suppress(ProcedureError):
                self.query_one(Picture).show(picture_thumbnail(read_picture(restored), "restored picture"))
        self._show_curve(mtf_plot([one] if one is not None else []))

    @property
    def glyphs(self) -> Glyphs:
        return self.query_one(Rail).glyphs

    def _complain(self, reason: str, remedy: str) -> None:
        self.query_one("#trouble", Part).say(f"{self.glyphs.bad}{self.glyphs.space}{sentences(reason, remedy)}", "bold")

    def _show_rail(self) -> None:
        if self._began is not None:
            self.query_one(Rail).show(self._began.plan, self._done, self._now)

    def _show_values(self, planes: Sequence[PlaneResult]) -> None:
        """The numbers that one accepts: all of one plane, the sharpness of the others."""
        first = sorted(planes, key=lambda plane: plane.name != "G1")[:1]
        lines = [line for plane in first for line in (plane.name, *number_lines(plane, self.glyphs))]
        others = [self.glyphs.spelt(plane_words(plane)) for plane in planes if plane not in first]
        values = self.query_one("#values", Part)
        values.update(lines_of(*lines, *others))
        values.display = bool(planes)
        self._make_room()

    def _show_curve(self, drawn: Plotted | None) -> None:
        curve = self.query_one(CurveView)
        curve.display = drawn is not None
        curve.show(drawn)
        self._make_room()

    def _show_readings(self, readings: Sequence[Reading]) -> None:
        self.query_one(Readings).show(readings)
        self._make_room()

    def _make_room(self) -> None:
        """Adapt the layout: the image takes the space of missing numbers and curves, and a drawing gives its own."""
        visible = any(self.query_one(f"#{name}").display for name in ("sign", "values", "readings", "curve"))
        self.query_one("#numbers").display = visible
        self.set_class(visible and self.query_one(Picture).picture is None, "-drawing")


def sentences(reason: str, remedy: str) -> str:
    """Reason and remedy as sentences: "The chart is dark. Add light."."""
    parts = (text.removesuffix(".") for text in (reason, remedy[:1].upper() + remedy[1:]) if text)
    return " ".join(f"{text}." for text in parts)
