"""State of the bench for its clients: devices, axes, run, newest picture; and its emergency stop."""

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import Any

from procedures.plan import Points
from station.bench.opening import Bench
from station.bench.stage_watch import DeviceState, StageWatch
from station.guide.coach import way_words, ways
from station.guide.frontend import CONSENTS, NOT_NOW
from station.guide.workspace import StationLab
from station.service.remote_operator import RunStatus
from station.service.runs import LatestPicture, Runs
from station.service.tenancy import Tenancy

STOPPERS = 512


class ServedBench:
    """A served lab: bench, tenancy, runs and pictures. Thread-safe."""

    def __init__(self, lab: StationLab) -> None:
        self.lab = lab
        opened = lab.open()
        self.bench: Bench | None = opened.bench
        self.rows = opened.rows
        self.tenancy = Tenancy()
        self.picture = LatestPicture()
        self.runs = Runs(lab, self.tenancy, self.picture)
        self.clients: Callable[[], list[dict[str, Any]]] = list
        """The Alpaca clients with their rights, as records."""
        self._executors: list[ThreadPoolExecutor] = []
        self.stopper = self.threads(STOPPERS, "stop")
        """Threads for stops only: more than connections, so that no stop waits for another."""
        self._watch = StageWatch(self.bench) if self.bench is not None else None
        self._looking = threading.Lock()
        self._last_states: list[DeviceState] = []
        self.states()

    def threads(self, most: int, name: str) -> ThreadPoolExecutor:
        """A pool with this many threads for one kind of request, until the bench is closed."""
        self._executors.append(ThreadPoolExecutor(most, name))
        return self._executors[-1]

    def states(self) -> list[DeviceState]:
        """Every device's state; the last one while another request still waits for a device."""
        if self._watch is not None and self._looking.acquire(blocking=False):
            try:
                self._last_states = list(self._watch.look())
            finally:
                self._looking.release()
        return self._last_states

    def status(self) -> dict[str, Any]:
        """The whole state, for a page that polls twice a second."""
        run = self.runs.status
        return {
            "devices": [_device(state) for state in self.states()],
            "tenant": self.tenancy.tenant,
            "clients": self.clients(),
            "run": run_record(run) if run is not None else None,
            "picture": self.picture.number,
            "stops": self.bench.stops if self.bench is not None else 0,
        }

    def stop(self) -> dict[str, Any]:
        """Stop everything; returns the delay on each line in milliseconds. Never raises."""
        before = self.bench.stops if self.bench is not None else 0
        self.runs.stop()
        stops = self.bench.stops_since(before) if self.bench is not None else []
        return {"stopped": self.bench is not None, "stops": [stop.record() for stop in stops]}

    def close(self, patience_s: float) -> None:
        """Stop, and let the run write its last line."""
        self.runs.stop()
        self.runs.wait(patience_s)
        for executor in self._executors:
            executor.shutdown(wait=False, cancel_futures=True)


def _device(state: DeviceState) -> dict[str, Any]:
    condition = state.condition
    return {
        "name": state.name,
        "state": condition.word,
        "usable": condition.usable,
        "remedy": condition.remedy,
        "caveat": asdict(condition.caveat) if condition.caveat is not None else None,
        "moving": state.moving,
        "places": dict(state.places),
    }


def run_record(status: RunStatus) -> dict[str, Any]:
    """The status of a run, as a record."""
    result, ask = status.result, status.question
    question = None
    if ask is not None:
        names = ("key", "question", "kind", "unit", "default", "low", "high", "choices")
        consent = CONSENTS.get(ask.key)
        question = {name: getattr(ask, name) for name in names}
        question |= {"consent": asdict(consent) if consent else None, "decline": NOT_NOW}
    return {
        **{name: getattr(status, name) for name in ("session", "plan", "step", "instruction", "drawing")},
        "doing": {"say": status.doing, "done": status.done, "total": status.total},
        "advice": status.advice.say if status.advice is not None else "",
        "coach": coach_record(status),
        "goal": status.goal.say if status.goal is not None else "",
        "readings": [{**asdict(r), "good": r.good} for r in (status.advice.readings if status.advice else ())],
        "trouble": asdict(status.trouble) if status.trouble is not None else None,
        "question": question,
        "result": {"verdict": result.verdict, "reason": result.reason, "remedy": result.remedy} if result else None,
        "gave": dict(status.gave),
        "ended": status.ended,
    }


def coach_record(status: RunStatus) -> dict[str, Any] | None:
    """The pose to match in the newest picture, in fractions of its sides; None where there is none."""
    outline = status.advice.outline if status.advice is not None else None
    if outline is None or status.ended is not None:
        return None
    rows, columns = status.shape

    def fractions(points: Points) -> list[tuple[float, float]]:
        return [((x + 0.5) / columns, (y + 0.5) / rows) for x, y in points]

    off = outline.off_px / math.hypot(rows, columns)
    return {
        "present": fractions(outline.present),
        "wanted": fractions(outline.wanted),
        "words": way_words(outline, status.shape) if outline.present else "",
        "arrows": [arrow for arrow, _ in ways(outline, status.shape)] if outline.present else [],
        "off": off if math.isfinite(off) else None,
        "good": status.advice is not None and status.advice.good,
        "hold_s": status.hold_s,
    }
