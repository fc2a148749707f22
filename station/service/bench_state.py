"""How the bench is now, for whoever asks: devices, axes, the run, the newest picture; and its stop."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import Any

from procedures.plan import Ask
from station.bench.opening import Bench
from station.bench.stage_watch import DeviceState, StageWatch
from station.guide.workspace import StationLab
from station.service.pictures import LatestPicture
from station.service.remote_operator import Told
from station.service.runs import Runs
from station.service.tenancy import Tenancy

STOPPERS = 512


class ServedBench:
    """A lab that is served: its bench, who has it, its runs and pictures. Any thread may call."""

    def __init__(self, lab: StationLab) -> None:
        self.lab = lab
        opened = lab.open()
        self.bench: Bench | None = opened.bench
        self.rows = opened.rows
        self.tenancy = Tenancy()
        self.picture = LatestPicture()
        self.runs = Runs(lab, self.tenancy, self.picture)
        self._executors: list[ThreadPoolExecutor] = []
        self.stopper = self.threads(STOPPERS, "stop")
        """Threads for stops alone: more than there are connections, so that no stop waits for another."""
        self._watch = StageWatch(self.bench) if self.bench is not None else None
        self._looking = threading.Lock()
        self._seen: list[DeviceState] = []
        self.states()

    def threads(self, most: int, name: str) -> ThreadPoolExecutor:
        """At most so many threads for one kind of request, until the bench is closed."""
        self._executors.append(ThreadPoolExecutor(most, name))
        return self._executors[-1]

    def states(self) -> list[DeviceState]:
        """Every device as it is; while another request still waits for a device's answer, as it was last."""
        if self._watch is not None and self._looking.acquire(blocking=False):
            try:
                self._seen = list(self._watch.look())
            finally:
                self._looking.release()
        return self._seen

    def status(self) -> dict[str, Any]:
        """All of it, for a page that asks twice a second."""
        told = self.runs.told
        return {
            "devices": [_device(one) for one in self.states()],
            "tenant": self.tenancy.tenant,
            "run": run_record(told) if told is not None else None,
            "picture": self.picture.number,
            "stops": self.bench.stops if self.bench is not None else 0,
        }

    def stop(self) -> dict[str, Any]:
        """Stop everything; when it was on which wire, after how many milliseconds. Never raises."""
        before = self.bench.stops if self.bench is not None else 0
        self.runs.stop()
        stops = self.bench.stops_since(before) if self.bench is not None else []
        return {"stopped": self.bench is not None, "stops": [one.record() for one in stops]}

    def close(self, patience_s: float) -> None:
        """Stop, and let the run write its last line."""
        self.runs.stop()
        self.runs.wait(patience_s)
        for executor in self._executors:
            executor.shutdown(wait=False, cancel_futures=True)


def _device(one: DeviceState) -> dict[str, Any]:
    told = one.condition
    return {
        "name": one.name,
        "state": told.word,
        "usable": told.usable,
        "remedy": told.remedy,
        "doubt": asdict(told.doubt) if told.doubt is not None else None,
        "moving": one.moving,
        "places": dict(one.places),
    }


def run_record(told: Told) -> dict[str, Any]:
    """How a run stands, for programs."""
    result = told.result
    return {
        "session": told.session,
        "plan": told.plan,
        "step": told.step,
        "instruction": told.instruction,
        "doing": {"say": told.doing, "done": told.done, "total": told.total},
        "advice": told.advice.say if told.advice is not None else "",
        "readings": [{**asdict(one), "good": one.good} for one in (told.advice.readings if told.advice else ())],
        "trouble": asdict(told.trouble) if told.trouble is not None else None,
        "question": question_record(told.question) if told.question is not None else None,
        "result": {"verdict": result.verdict, "reason": result.reason, "remedy": result.remedy} if result else None,
        "gave": dict(told.gave),
        "ended": told.ended,
    }


def question_record(ask: Ask) -> Mapping[str, Any]:
    """A question, for programs."""
    names = ("key", "question", "kind", "unit", "default", "low", "high", "choices")
    return {name: getattr(ask, name) for name in names}
