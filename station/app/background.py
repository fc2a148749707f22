"""Work beside a front end: threads of our own, cancelled twice, ended in a sentence. Knows no terminal."""

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
    """What went wrong, as a person reads it."""

    reason: str
    remedy: str


@dataclass(frozen=True)
class Finished:
    """A job came to its end: with a value, or with a problem."""

    job: BackgroundJob
    value: Any = None
    problem: Problem | None = None


class BackgroundJob:
    """Work in a thread of its own; `tell` hears once, in that thread, how it ended.

    The first `cancel` calls `ask`, which lets the work end what it is at; every further one calls `halt`, which ends
    it now.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[], Any],
        tell: Callable[[Finished], None],
        *,
        ask: Callable[[], None] | None = None,
        halt: Callable[[], None] | None = None,
    ) -> None:
        self.name = name
        self.asked = False
        self._work, self._tell, self._ask, self._halt = work, tell, ask, halt
        # a daemon: a terminal that is closed must not leave a process behind that waits for a wire
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> BackgroundJob:
        """Begin."""
        self._thread.start()
        return self

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._thread.is_alive()

    def wait(self, timeout_s: float) -> None:
        """Wait for its end, at most so long."""
        self._thread.join(timeout_s)

    def cancel(self) -> bool:
        """Ask it to end, or the second time make it; whether this was the asking."""
        first, self.asked = not self.asked, True
        end = self._ask if first else self._halt
        if end is not None:
            at_once(end)
        return first

    def _run(self) -> None:
        try:
            finished = Finished(self, self._work())
        except Exception as error:  # whatever it is, the operator reads a sentence
            finished = Finished(self, problem=problem_of(error))
        self._tell(finished)


def at_once(do: Callable[[], None]) -> threading.Thread:
    """Do it in a new thread, beside everything else that waits."""
    thread = threading.Thread(target=do, name="at once", daemon=True)
    thread.start()
    return thread


def problem_of(error: Exception) -> Problem:
    """An error as its sentence and its remedy."""
    if isinstance(error, ExplainedError):
        return Problem(error.reason, error.remedy)
    what = f"the program failed unexpectedly: {type(error).__name__}: {error}"
    return Problem(what, "nothing that was taken is lost; go on, and report this if it comes again")


# --- the devices, looked at now and then -------------------------------------------------------------------------


Look = Callable[[], "Sequence[DeviceState]"]


class Watcher:
    """Looks at the devices' conditions in a thread of its own, and tells when one has changed."""

    def __init__(
        self,
        look: Callable[[], Sequence[DeviceState]],
        tell: Callable[[Sequence[DeviceState]], None],
        every_s: float = 0.5,
    ) -> None:
        self._look, self._tell, self._every_s = look, tell, every_s
        self._end = threading.Event()
        threading.Thread(target=self._run, name="watcher", daemon=True).start()

    def stop(self) -> None:
        """Look no more."""
        self._end.set()

    def _run(self) -> None:
        last: Sequence[DeviceState] | None = None
        while not self._end.is_set():
            states = list(self._look())
            if states != last:
                last = states
                self._tell(states)
            self._end.wait(self._every_s)
