"""Background work of a front end: threads with a two-stage cancellation and a result. Independent of the terminal."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from station.common.errors import ExplainedError

if TYPE_CHECKING:
    from station.bench.stage_watch import DeviceState


@dataclass(frozen=True)
class Problem:
    """A problem and its remedy, as text."""

    reason: str
    remedy: str


@dataclass(frozen=True)
class Finished:
    """The end of a job: a value, or a problem."""

    job: BackgroundJob
    value: Any = None
    problem: Problem | None = None


class BackgroundJob:
    """Work in a thread of its own; `on_finished` is called once, in that thread, with its end. The first `cancel` calls
    `ask`, which ends the work after its current action; every further one calls `halt`, which ends it now."""

    def __init__(
        self,
        name: str,
        work: Callable[[], Any],
        on_finished: Callable[[Finished], None],
        *,
        ask: Callable[[], None] | None = None,
        halt: Callable[[], None] | None = None,
    ) -> None:
        self.name = name
        self.asked = False
        self._work, self._on_finished, self._ask, self._halt = work, on_finished, ask, halt
        # a daemon: closing the terminal must not leave a process that waits for a device
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> BackgroundJob:
        self._thread.start()
        return self

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def wait(self, timeout_s: float) -> None:
        self._thread.join(timeout_s)

    def cancel(self) -> bool:
        """Ask it to end, or the second time halt it. Gives whether this was the first time."""
        first, self.asked = not self.asked, True
        end = self._ask if first else self._halt
        if end is not None:
            at_once(end)
        return first

    def _run(self) -> None:
        try:
            finished = Finished(self, self._work())
        except Exception as error:  # the operator reads every error as a sentence
            finished = Finished(self, problem=problem_of(error))
        self._on_finished(finished)


def at_once(do: Callable[[], None]) -> threading.Thread:
    """Call it in a new thread, without waiting for other work."""
    thread = threading.Thread(target=do, name="at once", daemon=True)
    thread.start()
    return thread


def problem_of(error: Exception) -> Problem:
    """An error as its sentence and its remedy."""
    if isinstance(error, ExplainedError):
        return Problem(error.reason, error.remedy)
    what = f"unexpected error of the program: {type(error).__name__}: {error}"
    return Problem(what, "no photograph is lost; continue, and report this error if it happens again")


Look = Callable[[], "Sequence[DeviceState]"]
EVERY_S = 0.5


class Watcher:
    """Polls the devices' conditions in a thread of its own, and calls `on_change` when one has changed."""

    def __init__(self, look: Look, on_change: Callable[[Sequence[DeviceState]], None]) -> None:
        self._look, self._on_change = look, on_change
        self._end = threading.Event()
        threading.Thread(target=self._run, name="watcher", daemon=True).start()

    def stop(self) -> None:
        self._end.set()

    def _run(self) -> None:
        last: Sequence[DeviceState] | None = None
        while not self._end.is_set():
            states = list(self._look())
            if states != last:
                last = states
                self._on_change(states)
            self._end.wait(EVERY_S)
