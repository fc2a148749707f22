"""The half of the application that works: jobs in threads, the bench, runs and what they tell.

Whatever blocks (wires, disks, numpy) runs in threads of ours and comes back as a message; the event loop only paints.
"""

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
from station.app.messages import Devices, Ended, News, Terminated
from station.app.screens.dialogs import Choose
from station.app.screens.parts import AnswerBox, StationScreen
from station.app.screens.start import StartScreen
from station.app.stopping_driver import stopping_first
from station.common.errors import TRACEBACK
from station.common.stop_signals import EXIT_DEVICE
from station.drawing.glyphs import Glyphs, glyphs_for, visible

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.interfaces import Condition
    from station.app.mailbox import Desk, Sitting
    from station.app.screens.guide import GuideScreen
    from station.bench.opening import Bench, DeviceRow
    from station.bench.stage_watch import DeviceState
    from station.guide.workspace import Kept, Lab, Running

SHOW_EVERY_S = 0.08
"""What runs tell is shown at most so often: 12 times a second is as much as an eye or an ssh line wants."""
GUIDE, BENCH, FOCUS, RESULTS = "guide", "bench", "focus", "results"
NO_BENCH = "No bench is configured: write a station.toml, or start with --simulate."
ALARM = "EMERGENCY STOP: everything was halted. Stages must be homed to move again."


class WorkingApp(App[int]):
    """An application that has a bench, does jobs, and attends runs; its value is the exit code."""

    def __init__(self, lab: Lab, glyphs: Glyphs | None = None) -> None:
        super().__init__()
        self.lab = lab
        self.glyphs = glyphs or glyphs_for(os.environ, sys.stdout.encoding or "")
        self.bench: Bench | None = None
        self.rows: Sequence[DeviceRow] = ()
        self._jobs: dict[str, BackgroundJob] = {}
        self._states: Sequence[DeviceState] = ()
        self._bench_words, self.why_no_bench = "opening the bench", "The bench is being opened."
        self._watcher: Watcher | None = None
        self._guide: GuideScreen | None = None
        self._sitting: Sitting | None = None
        self._session: Path | None = None
        self._subject = self._alarm = ""
        self._wanted: Callable[[Desk], Running] | None = None
        self._wanted_mode = ""
        self._is_loaded = self._run_is_due = self._focus_on_bench = False
        self._afterwards: Callable[[], object] | None = None
        self._shown_s = 0.0
        self._drain_is_due = False

    # --- beginning and end ---------------------------------------------------------------------------------------

    def on_mount(self) -> None:
        """Paint first; numpy, bench and sessions come after."""
        self.call_after_refresh(self._start, "load", lambda: _load(self.lab))

    @on(Terminated)
    def _terminated(self) -> None:
        self.exit(EXIT_DEVICE)

    def terminate(self) -> None:
        """Stop the bench and leave; from any thread."""
        self._halt()
        self._post(Terminated())

    def finish(self, timeout_s: float) -> None:
        """Wait for the run to end, once the application has: it writes its last line."""
        for job in list(self._jobs.values()):
            job.wait(timeout_s)

    def _fatal_error(self) -> None:
        """A fault of the program: the bench stops; a sentence for the operator, the traceback for whoever asks."""
        self._halt()
        if os.environ.get(TRACEBACK) or self._exception is None or self.is_headless:
            super()._fatal_error()
            return
        told = problem_of(self._exception)
        self.panic(Text(visible(f"{told.reason}; {told.remedy}")))

    def on_unmount(self) -> None:
        """Let nothing run on behind a closed terminal."""
        if self._watcher is not None:
            self._watcher.stop()

    # --- jobs ----------------------------------------------------------------------------------------------------

    def _start(self, name: str, work: Callable[[], Any], **ends: Callable[[], None]) -> None:
        self._jobs[name] = BackgroundJob(name, work, self.tell, **ends).start()

    def tell(self, finished: Finished) -> None:
        """A job's last word; from its thread."""
        self._post(Ended(finished))

    def _post(self, message: Message) -> None:
        with suppress(RuntimeError):  # the loop is closed: nobody is there to hear
            self.post_message(message)

    def running(self, name: str) -> BackgroundJob | None:
        """The job of that name, while it runs."""
        job = self._jobs.get(name)
        return job if job is not None and job.running else None

    @property
    def bench_taken(self) -> str:
        """Why the bench cannot be used by hand now; empty where it can."""
        if self._run_is_due:
            return "The guide is at work: end its run first (Ctrl+C)."
        if self._focus_on_bench and self.running("focus"):
            return "Live focus has the bench: end it first (F7, then Esc)."
        return "One thing at a time: the bench is still at the last." if self.running("by hand") else ""

    def by_hand(self, work: Callable[[], Any]) -> None:
        """Something on the bench screen's behalf."""
        self._start("by hand", work, halt=self.lab.emergency_stop)

    def focus(self, work: Callable[[], Any], end: Callable[[], None], *, on_bench: bool) -> None:
        """Live focus on its screen's behalf; photographs in a folder leave the bench to others."""
        self._focus_on_bench = on_bench
        self._start("focus", work, ask=end, halt=self.lab.emergency_stop)

    @on(Ended)
    def _ended(self, message: Ended) -> None:
        if not self.is_running:  # the screens are being taken down
            return
        finished = message.finished
        handle = {
            "load": self._loaded,
            "open": self._opened,
            "run": self._run_ended,
            "by hand": self._moved_by_hand,
            "focus": self._tell_screens,
            "results": self._results_read,
            "sessions": self._sessions_read,
        }[finished.job.name]
        if self._jobs.get(finished.job.name) is finished.job:
            del self._jobs[finished.job.name]  # it may not have left its thread yet; its work is done
        handle(finished)
        self.refresh_frame()

    def _loaded(self, finished: Finished) -> None:
        # what is loaded stays: looking through it for garbage would hold the loop for a tenth of a second, now and then
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
        if self._wanted_mode:  # its key was pressed while the program was still loading
            self.clear_notifications()  # that it was still loading
            self.switch_mode(self._wanted_mode)

    def _opened(self, finished: Finished) -> None:
        if finished.value is not None:
            self.bench, self.rows = finished.value.bench, finished.value.rows
        bench = self.bench
        self._bench_words = "no bench: every move is made by hand" if bench is None else ""
        self.why_no_bench = NO_BENCH
        if finished.problem is not None:
            self._bench_words = "the bench could not be opened"
            self.why_no_bench = f"{finished.problem.reason}. {finished.problem.remedy}."
            self._complain(finished.problem)
        if bench is not None:
            from station.bench.stage_watch import StageWatch

            self._watcher = Watcher(StageWatch(bench).look, lambda states: self._post(Devices(states)))

    def _moved_by_hand(self, finished: Finished) -> None:
        if finished.problem is None:
            self._alarm = ""
        if isinstance(finished.value, list):
            self.rows = finished.value
        self._tell_screens(finished)

    def _tell_screens(self, finished: Finished) -> None:
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
        self.notify(visible(f"{problem.reason}. {problem.remedy}."), severity="error", markup=False, timeout=20)

    # --- runs ----------------------------------------------------------------------------------------------------

    @on(StartScreen.Begin)
    def _begin_new(self, message: StartScreen.Begin) -> None:
        self._subject = f"{message.camera}, {message.lens}"
        self._begin(lambda desk: self.lab.begin(message.plan, message.camera, message.lens, desk))

    @on(StartScreen.Resume)
    def _resume(self, message: StartScreen.Resume) -> None:
        self._subject = message.folder.name
        self._begin(lambda desk: self.lab.resume(message.folder, desk))

    @on(GoOn)
    def _go_on(self) -> None:
        folder = self._session
        if folder is not None:
            self._begin(lambda desk: self.lab.resume(folder, desk))

    @on(StepBack)
    def _step_back(self) -> None:
        folder, step = self._session, self._guide.step_before if self._guide else None
        if folder is None or step is None:
            return
        self._afterwards = lambda: self._begin(lambda desk: self.lab.resume(folder, desk, back_to=step))
        self._end_run_then_go_on()

    def _begin(self, begin: Callable[[Desk], Running]) -> None:
        """Carry out a run, once all that it needs has been loaded; one at a time, and not beside a move by hand."""
        if not self._is_loaded:  # nor, perhaps, even begun to: that waits until the first screen is painted
            self._wanted = begin
            return
        if taken := self.bench_taken:
            self.notify(taken, markup=False)
            return
        from station.app.mailbox import Sitting
        from station.app.screens.guide import GuideScreen

        self._wanted, self._alarm, self._run_is_due = None, "", True
        self._sitting = Sitting(begin, lambda: self._post(News()), self.lab.emergency_stop)
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
        left = self.return_code is not None  # a screen that comes up then has no parts any more
        if self._sitting is not None and self._guide is not None and not left:
            self._guide.begin("Opening the session and the bench.")
            self._start("run", self._sitting.work, ask=self._sitting.ask, halt=self._sitting.halt)
            self.refresh_frame()

    @on(News)
    def _news(self) -> None:
        """Show what has gathered, now or when it is time again."""
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
        guide, sitting = self._guide if self._guide is not None and self._guide.whole else None, self._sitting
        for news in sitting.desk.take() if sitting is not None and guide is not None else ():
            assert guide is not None  # a run begins when its screen is there
            if isinstance(news, RunBegan):
                self._session = news.session
            if not isinstance(news, RunEnded):  # it is shown when the run has left the bench
                guide.show(news)
            if isinstance(news, Question) and self.front is not guide:
                self.bell()
                self.notify(visible(f"The guide (F2) asks: {news.ask.question}"), markup=False)

    @on(AnswerBox.Given)
    def _answered(self, message: AnswerBox.Given) -> None:
        if self._sitting is not None:
            self._sitting.desk.reply(message.fact)

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
        """Once: after this exposure, now if an axis moves. Twice: now."""
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
        """Whether a stage of the bench moves; from any thread."""
        return self.bench is not None and self.bench.motions.under_way

    @on(StopEverything)
    def stop_everything(self) -> None:
        """Stop the bench at once, in a thread of its own, and whatever runs."""
        self._halt()
        if isinstance(self.screen, Choose) and self.screen.moves:
            self.screen.close(None)  # the next key must not begin what was just stopped
        self._alarm = ALARM
        self.bell()
        self.refresh_frame()

    def _halt(self) -> None:
        if self._focus_on_bench and (focus := self.running("focus")):
            focus.cancel()
        running = self._sitting is not None and self.running("run")
        at_once(self._sitting.halt if self._sitting is not None and running else self.lab.emergency_stop)

    def get_driver_class(self) -> type[Driver]:
        """The terminal's driver, whose thread stops the bench when it reads the key, whatever the screens are at."""
        return stopping_first(
            super().get_driver_class(), lambda: self.lab.emergency_stop(), lambda: self.axis_moves
        )  # the lab comes later

    # --- what is shown -------------------------------------------------------------------------------------------

    @property
    def front(self) -> StationScreen:
        """The screen that is shown, below any dialog."""
        return next(one for one in reversed(self.screen_stack) if isinstance(one, StationScreen))

    @property
    def conditions(self) -> Mapping[str, Condition]:
        """How each device is, by name, as it was seen last."""
        return {one.name: one.condition for one in self._states}

    @property
    def places(self) -> Mapping[str, float]:
        """Where the axes are, by name, as the wires told it last."""
        return {axis: place for one in self._states for axis, place in one.places.items()}

    @property
    def _start_screen(self) -> StartScreen:
        return next(one for one in self.get_screen_stack(GUIDE) if isinstance(one, StartScreen))

    @on(Devices)
    def _devices_changed(self, message: Devices) -> None:
        self._states = message.states
        self.refresh_frame()

    def refresh_frame(self) -> None:
        """Bring the screen that is shown up to date."""
        if self.is_running:
            self.front.refresh_frame()


def _load(lab: Lab) -> tuple[Mapping[str, str], Sequence[Kept]]:
    """Import what screens and runs need, and read what is on the disk; in a thread."""
    import station.app.screens.bench
    import station.app.screens.focus
    import station.app.screens.guide
    import station.app.screens.results  # noqa: F401

    return lab.plans(), lab.kept()
