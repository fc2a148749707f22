"""The first screen: begin a new session, or continue one. Enter accepts the defaults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.message import Message
from textual.widgets import Input

from station.app.bars import brief
from station.app.commands import ShowFocus
from station.app.screens.parts import Choices, StationScreen
from station.app.widgets import Part, lines_of

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.interfaces import Condition
    from station.guide.workspace import SessionSummary

USUAL_PLAN = {"pattern": "the PSF from a printed noise chart"}
"""Shown until the catalogue of plans has been loaded."""

LIVE_FOCUS = f"live focus: which way to turn the ring, without a calibration ({ShowFocus.key_name()})"


class StartScreen(StationScreen):
    """Camera, lens and plan; below them the existing sessions."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("down", "app.focus_next", show=False),
        Binding("up", "app.focus_previous", show=False),
    ]

    class Begin(Message):
        """Begin a new session."""

        def __init__(self, plan: str, camera: str, lens: str) -> None:
            super().__init__()
            self.plan, self.camera, self.lens = plan, camera, lens

    class Resume(Message):
        """Continue a session."""

        def __init__(self, folder: Path) -> None:
            super().__init__()
            self.folder = folder

    def __init__(self, camera: str, lens: str, plan: str | None = None) -> None:
        super().__init__()
        self._names = camera, lens
        self._plan = plan
        self._plans: Mapping[str, str] = USUAL_PLAN
        self._kept: Sequence[SessionSummary] = ()

    def body(self) -> ComposeResult:
        camera, lens = self._names
        with VerticalScroll(id="form", can_focus=False):
            for what, name in (("camera", camera), ("lens", lens)):
                with Horizontal(classes="row"):
                    yield Part(f"Name of the {what}", classes="label-left")
                    yield Input(name, id=what, compact=True, max_length=80)
            yield Part("What to measure: press Enter to begin; arrow keys reach camera and lens", classes="label")
            yield Choices(self._plan_lines(), id="plans")
            with Vertical(id="old"):
                yield Part("Or continue a session (arrow down, then Enter)", classes="label", id="old-label")
                yield Choices(id="kept")
            yield Part(id="to-do", classes="label")

    def on_mount(self) -> None:
        """Focus the plans; the sessions are shown once they have been read."""
        super().on_mount()
        self.query_one("#old").display = False
        self.query_one("#plans").focus()

    def refresh_frame(self) -> None:
        """Update the frame, and the remedy for each device that cannot be used yet."""
        super().refresh_frame()
        if self.is_mounted:
            conditions: Mapping[str, Condition] = self.app.conditions  # type: ignore[attr-defined]
            lines = [_remedy(name, condition) for name, condition in conditions.items() if not condition.usable]
            part = self.query_one("#to-do", Part)
            part.update(lines_of(*lines))
            part.display = bool(lines)

    def show_plans(self, plans: Mapping[str, str]) -> None:
        """Show the plans once they are loaded."""
        self._plans = plans
        at = next((i for i, name in enumerate(plans) if name == self._plan), 0)
        self.query_one("#plans", Choices).set_lines(self._plan_lines(), at)

    def _plan_lines(self) -> list[str]:
        return [*self._plans.values(), LIVE_FOCUS]

    def show_kept(self, kept: Sequence[SessionSummary]) -> None:
        self._kept = sorted(kept, key=lambda one: one.ended == "finished")
        if kept:  # propose camera and lens of the last session, unless something else was typed
            names = kept[0].camera, kept[0].lens
            for part, usual, last in zip(("camera", "lens"), self._names, names, strict=True):
                box = self.query_one(f"#{part}", Input)
                if box.value == usual:
                    box.value = last
                    box.action_select_all()
            self._names = names
        self.query_one("#old").display = bool(self._kept)
        self.query_one("#kept", Choices).set_lines([kept_in_words(one) for one in self._kept])

    def on_input_submitted(self, event: Input.Submitted) -> None:
        self.focus_next()

    def on_choices_beyond(self, event: Choices.Beyond) -> None:
        if event.by > 0:
            self.focus_next()
        else:
            self.focus_previous()

    def on_choices_chosen(self, event: Choices.Chosen) -> None:
        if event.choices.id == "kept":
            self.post_message(self.Resume(self._kept[event.index].folder))
            return
        if event.index == len(self._plans):
            self.post_message(ShowFocus())
            return
        if self._plan is not None and self._plans is USUAL_PLAN:
            return  # the requested plan has not been loaded yet
        camera, lens = (self.query_one(f"#{name}", Input).value.strip() or name for name in ("camera", "lens"))
        self.post_message(self.Begin(list(self._plans)[event.index], camera, lens))


def _remedy(name: str, one: Condition) -> str:
    """Condition of a device and its remedy, by the guide, which homes, or on the bench screen."""
    unhomed = "home" in one.remedy
    return f"{name}: {brief(one)}: {'the guide homes it; or press F3, then H' if unhomed else f'{one.remedy} (see F3)'}"


def kept_in_words(summary: SessionSummary) -> str:
    """A session on one line: date, subject, progress."""
    steps = f"{len(summary.done)} step{'s' * (len(summary.done) != 1)} done"
    state = "finished" if summary.ended == "finished" else f"{steps}, {summary.ended}" if summary.ended else steps
    return f"{summary.began[:16].replace('T', ' ')}  {summary.camera}, {summary.lens}, {summary.plan}: {state}"
