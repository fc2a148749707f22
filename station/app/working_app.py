"""Base of the application: jobs in threads, the bench, runs and their events. Blocking work (devices, disks, numpy)
runs in threads and returns as messages; the event loop only paints."""

from __future__ import annotations

import gc
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rich.text import Text
from textual import on
from textual.app import App
from textual.driver import Driver
from textual.message import Message

from station.app.background import BackgroundJob, Finished, Problem, Watcher, at_once, problem_of
from station.app.commands import EndRun, GoOn, StepBack, StopEverything
from station.app.screens.dialogs import Choose
from station.app.screens.parts import AnswerBox, StationScreen
from station.app.screens.start import StartScreen
from station.app.stopping_driver import stopping_first
from station.app.terminal_report import Graphics
from station.common.errors import TRACEBACK
from station.common.sanitise import printable
from station.common.stop_signals import EXIT_DEVICE
from station.drawing.glyphs import Glyphs, glyphs_for

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.interfaces import Condition
    from station.app.mailbox import Mailbox, OperatorSession
    from station.app.screens.guide import GuideScreen
    from station.bench.opening import Bench, DeviceRow
    from station.bench.stage_watch import DeviceState
    from station.guide.run import Run
    from station.guide.workspace import SessionSummary, StationLab


class MailboxFilled(Message):
    """The mailbox has entries."""


class ProgramTerminated(Message):
    """The system ends the program, or the terminal has closed."""


class JobEnded(Message):
    """A job has ended."""

    def __init__(self, finished: Finished) -> None:
        super().__init__()
        self.finished = finished


class DevicesChanged(Message):
    """The condition of a device has changed."""

    def __init__(self, states: Sequence[DeviceState]) -> None:
        super().__init__()
        self.states = states


SHOW_EVERY_S = 0.08
"""Shortest interval between updates from a run; 12 per second suffice for the eye and for ssh."""
GUIDE, BENCH, FOCUS, RESULTS = "guide", "bench", "focus", "results"
NO_BENCH = "No bench is configured: write a station.toml, or start with --simulate."
ALARM = "EMERGENCY STOP: every device was stopped. Home the stages before moving again."


class WorkingApp(App[int]):
    """An application with a bench, jobs and runs; its value is the exit code."""

    def __init__(self, lab: StationLab, glyphs: Glyphs | None = None, graphics: Graphics | None = None) -> None:
        super().__init__()
        self.lab = lab
        self.glyphs = glyphs or glyphs_for(os.environ, sys.stdout.encoding or "")
        self.graphics = graphics or Graphics()
        self.bench: Bench | None = None
        self.rows: Sequence[DeviceRow] = ()
        self._jobs: dict[str, BackgroundJob] = {}
        self._states: Sequence[DeviceState] = ()
        self._bench_words, self.why_no_bench = "opening the bench", "The bench is being opened."
        self._watcher: Watcher | None = None
        self._guide: GuideScreen | None = None
        self._operator_session: OperatorSession | None = None
        self._session: Path | None = None
        self._subject = self._alarm = ""
        self._wanted: Callable[[Mailbox], Run] | None = None
        self._wanted_mode = ""
        self._is_loaded = self._run_is_due = self._focus_on_bench = False
        self._afterwards: Callable[[], object] | None = None
        self._shown_s = 0.0
        self._drain_is_due = False

    def on_mount(self) -> None:
        self.call_after_refresh(self._start, "load", lambda: _load(self.lab))

    @on(ProgramTerminated)
    def _terminated(self) -> None:
        self.exit(EXIT_DEVICE)

    def terminate(self) -> None:
        """Stop the bench and leave; from any thread."""
        self._halt()
        self._post(ProgramTerminated())

    def finish(self, timeout_s: float) -> None:
        """Wait for the run to write its last line after the application has ended."""
        for job in list(self._jobs.values()):
            job.wait(timeout_s)

    def _fatal_error(self) -> None:
        """After an unexpected error, stop the bench and show a sentence, or the traceback on request."""
        self._halt()
        if os.environ.get(TRACEBACK) or self._exception is None or self.is_headless:
            super()._fatal_error()
            return
        problem = problem_of(self._exception)
        self.panic(Text(printable(f"{problem.reason}; {problem.remedy}")))

    def on_unmount(self) -> None:
        if self._watcher is not None:
            self._watcher.stop()

    def _start(self, name: str, work: Callable[[], Any], **ends: Callable[[], None]) -> None:
        self._jobs[name] = BackgroundJob(name, work, self.report_finished, **ends).start()

    def report_finished(self, finished: Finished) -> None:
        """Post the end of a job; from its thread."""
        self._post(JobEnded(finished))

    def _post(self, message: Message) -> None:
        with suppress(RuntimeError):  # the loop is closed
            self.post_message(message)

    def running(self, name: str) -> BackgroundJob | None:
        """The job by name while it runs, else None."""
        job = self._jobs.get(name)
        return job if job is not None and job.running else None

    @property
    def bench_taken(self) -> str:
        """Why the bench cannot be used manually now; empty where it can."""
        if self._run_is_due:
            return "The guide uses the bench: end its run first (Ctrl+C)."
        if self._focus_on_bench and self.running("focus"):
            return "Live focus uses the bench: end it first (F7, then Esc)."
        return "The bench is busy with the last command: wait, or press F12." if self.running("by hand") else ""

    def by_hand(self, work: Callable[[], Any]) -> None:
        self._start("by hand", work, halt=self.lab.emergency_stop)

    def focus(self, work: Callable[[], Any], end: Callable[[], None], *, on_bench: bool) -> None:
        """Run live focus; photographs from a folder leave the bench free."""
        self._focus_on_bench = on_bench
        self._start("focus", work, ask=end, halt=self.lab.emergency_stop)

    @on(JobEnded)
    def _ended(self, message: JobEnded) -> None:
        if not self.is_running:  # the screens are being removed
            return
        finished = message.finished
        handle = {
            "load": self._loaded,
            "open": self._opened,
            "run": self._run_ended,
            "by hand": self._moved_by_hand,
            "focus": self._notify_screens,
            "results": self._results_read,
            "sessions": self._sessions_read,
        }[finished.job.name]
        if self._jobs.get(finished.job.name) is finished.job:
            del self._jobs[finished.job.name]  # its thread may still be ending
        handle(finished)
        self.refresh_frame()

    def _loaded(self, finished: Finished) -> None:
        # loaded modules stay: scanning them for garbage would block the loop for 0.1 s now and then
        gc.freeze()
        self._is_loaded = True
        if finished.problem is not None:
            self._complain(finished.problem)
            return
        plans, kept = finished.value
        self._start_screen.show_plans(plans)
        self._start_screen.show_kept(kept)
        self._start("open", self.lab.open)
        if self._wanted is not None:
            self._begin(self._wanted)
        if self._wanted_mode:  # its key was pressed during loading
            self.clear_notifications()  # of the loading
            self.switch_mode(self._wanted_mode)

    def _opened(self, finished: Finished) -> None:
        if finished.value is not None:
            self.bench, self.rows = finished.value.bench, finished.value.rows
        bench = self.bench
        self._bench_words = "no bench: every move is made manually" if bench is None else ""
        self.why_no_bench = NO_BENCH
        if finished.problem is not None:
            self._bench_words = "the bench could not be opened"
            self.why_no_bench = f"{finished.problem.reason}. {finished.problem.remedy}."
            self._complain(finished.problem)
        if bench is not None:
            from station.bench.stage_watch import StageWatch

            self._watcher = Watcher(StageWatch(bench).look, lambda states: self._post(DevicesChanged(states)))

    def _moved_by_hand(self, finished: Finished) -> None:
        if finished.problem is None:
            self._alarm = ""
        if isinstance(finished.value, list):
            self.rows = finished.value
        self._notify_screens(finished)

    def _notify_screens(self, finished: Finished) -> None:
        for screen in (one for stack in self._screen_stacks.values() for one in stack):
            if isinstance(screen, StationScreen) and screen.is_mounted:
                screen.done(finished)

    def _results_read(self, finished: Finished) -> None:
        from station.app.screens.results import ResultsScreen

        if finished.problem is not None:
            self._complain(finished.problem)
        elif isinstance(self.front, ResultsScreen):
            self.front.show_entries(finished.value)

    def _sessions_read(self, finished: Finished) -> None:
        if finished.problem is None:
            self._start_screen.show_kept(finished.value)

    def _complain(self, problem: Problem) -> None:
        self.notify(printable(f"{problem.reason}. {problem.remedy}."), severity="error", markup=False, timeout=20)

    @on(StartScreen.Begin)
    def _begin_new(self, message: StartScreen.Begin) -> None:
        self._subject = f"{message.camera}, {message.lens}"
        self._begin(lambda mailbox: self.lab.begin(message.plan, message.camera, message.lens, mailbox))

    @on(StartScreen.Resume)
    def _resume(self, message: StartScreen.Resume) -> None:
        self._subject = message.folder.name
        self._begin(lambda mailbox: self.lab.resume(message.folder, mailbox))

    @on(GoOn)
    def _go_on(self) -> None:
        folder = self._session
        if folder is not None:
            self._begin(lambda mailbox: self.lab.resume(folder, mailbox))

    @on(StepBack)
    def _step_back(self) -> None:
        folder, step = self._session, self._guide.step_before if self._guide else None
        if folder is None or step is None:
            return
        self._afterwards = lambda: self._begin(lambda mailbox: self.lab.resume(folder, mailbox, back_to=step))
        self._end_run_then_go_on()

    def _begin(self, begin: Callable[[Mailbox], Run]) -> None:
        """Carry out a run once everything is loaded; not during another run or a manual move."""
        if not self._is_loaded:  # loading begins after the first paint
            self._wanted = begin
            return
        if taken := self.bench_taken:
            self.notify(taken, markup=False)
            return
        from station.app.mailbox import OperatorSession
        from station.app.screens.guide import GuideScreen

        self._wanted, self._alarm, self._run_is_due = None, "", True
        self._operator_session = OperatorSession(begin, lambda: self._post(MailboxFilled()), self.lab.emergency_stop)
        if self._guide is None:
            self._guide = GuideScreen()
            self.push_screen(self._guide, mode=GUIDE)
        else:
            self._start_run()

    @on(StationScreen.Ready)
    def _screen_is_ready(self, message: StationScreen.Ready) -> None:
        if message.screen is self._guide:
            self._start_run()

    def _start_run(self) -> None:
        exiting = self.return_code is not None  # a screen that appears then has no parts
        if self._operator_session is not None and self._guide is not None and not exiting:
            self._guide.begin("Opening the session and the bench.")
            session = self._operator_session
            self._start("run", session.work, ask=session.ask, halt=session.halt)
            self.refresh_frame()

    @on(MailboxFilled)
    def _on_mailbox_filled(self) -> None:
        wait_s = self._shown_s + SHOW_EVERY_S - time.monotonic()
        if wait_s <= 0:
            self._drain()
        elif not self._drain_is_due:
            self._drain_is_due = True
            self.set_timer(wait_s, self._drain)

    def _drain(self) -> None:
        from station.app.mailbox import Question
        from station.guide.frontend import RunBegan, RunEnded

        if not self.is_running:
            return
        self._drain_is_due, self._shown_s = False, time.monotonic()
        guide, session = self._guide if self._guide is not None and self._guide.whole else None, self._operator_session
        for entry in session.mailbox.take() if session is not None and guide is not None else ():
            assert guide is not None  # a run begins when its screen is there
            if isinstance(entry, RunBegan):
                self._session = entry.session
            if not isinstance(entry, RunEnded):  # it is shown when the run has released the bench
                guide.show(entry)
            if isinstance(entry, Question) and self.front is not guide:
                self.bell()
                self.notify(printable(f"The guide (F2) asks: {entry.ask.question}"), markup=False)

    @on(AnswerBox.Given)
    def _answered(self, message: AnswerBox.Given) -> None:
        if self._operator_session is not None:
            self._operator_session.mailbox.reply(message.fact)

    def _run_ended(self, finished: Finished) -> None:
        self._drain()
        self._run_is_due = False
        guide = self._guide if self._guide is not None and self._guide.whole else None
        if finished.problem is not None and guide is not None:
            guide.fail(finished.problem)
        elif guide is not None:
            guide.show(finished.value)
        if self._afterwards is not None:
            then, self._afterwards = self._afterwards, None
            then()

    @on(EndRun)
    def _end_run(self) -> None:
        """Pressed once: end after this exposure, at once if an axis moves. Twice: at once."""
        if self.axis_moves:
            self.stop_everything()
            return
        by_hand, run = self.running("by hand") or self.running("focus"), self.running("run")
        if run is not None:
            if run.cancel() and self._guide is not None:
                self._guide.ending()
        elif by_hand is not None:
            by_hand.cancel()
        else:
            self.notify("Nothing is running. Ctrl+Q leaves the program.", markup=False)

    def _end_run_then_go_on(self) -> None:
        run = self.running("run")
        if run is not None:
            run.cancel()
        elif self._afterwards is not None:
            then, self._afterwards = self._afterwards, None
            then()

    @property
    def axis_moves(self) -> bool:
        """Whether a stage moves; from any thread."""
        return self.bench is not None and self.bench.motions.under_way

    @on(StopEverything)
    def stop_everything(self) -> None:
        """Stop the bench and every job at once, in a thread of its own."""
        self._halt()
        if isinstance(self.screen, Choose) and self.screen.moves:
            self.screen.close(None)  # the next key must not start what was just stopped
        self._alarm = ALARM
        self.bell()
        self.refresh_frame()

    def _halt(self) -> None:
        if self._focus_on_bench and (focus := self.running("focus")):
            focus.cancel()
        session = self._operator_session
        at_once(session.halt if session is not None and self.running("run") else self.lab.emergency_stop)

    def get_driver_class(self) -> type[Driver]:
        """The terminal driver, whose thread stops the bench when it reads the stop key."""
        return stopping_first(
            super().get_driver_class(), lambda: self.lab.emergency_stop(), lambda: self.axis_moves
        )  # the lab comes later

    @property
    def front(self) -> StationScreen:
        return next(one for one in reversed(self.screen_stack) if isinstance(one, StationScreen))

    @property
    def conditions(self) -> Mapping[str, Condition]:
        return {state.name: state.condition for state in self._states}

    @property
    def places(self) -> Mapping[str, float]:
        return {axis: place for state in self._states for axis, place in state.places.items()}

    @property
    def _start_screen(self) -> StartScreen:
        return next(one for one in self.get_screen_stack(GUIDE) if isinstance(one, StartScreen))

    @on(DevicesChanged)
    def _devices_changed(self, message: DevicesChanged) -> None:
        self._states = message.states
        self.refresh_frame()

    def refresh_frame(self) -> None:
        if self.is_running:
            self.front.refresh_frame()


def _load(lab: StationLab) -> tuple[Mapping[str, str], Sequence[SessionSummary]]:
    """Import the modules of screens and runs, and read the sessions; in a thread."""
    import station.app.screens.bench
    import station.app.screens.focus
    import station.app.screens.guide
    import station.app.screens.results  # noqa: F401

    return lab.plans(), lab.kept()
