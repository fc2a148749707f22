"""A lab with scripted runs, without bench and computations."""

import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DeviceError, SystemClock
from drivers.interfaces import Condition, Identity, Travel
from drivers.wire.connection import Transcript
from procedures.drawings import steps as drawings
from procedures.plan import Advice, Ask, Plan, Reading, Step
from procedures.raw import Plane
from station.app.mailbox import Mailbox
from station.bench.opening import Bench
from station.guide.frontend import FrameEvent, ProgressEvent, RunBegan, RunEnded, StepBegan, StepEnded, Stopped
from station.guide.workspace import OpenedBench, SessionSummary

STEPS = ("print", "distance", "focus", "shots")
GAVE = {"print": "300 mm", "distance": "s/t 1.28", "focus": "MTF50 0.41", "shots": "±0.0012"}
PLAN = Plan(
    "pattern",
    "PSF from a chart",
    tuple(Step(n, n.capitalize(), f"Instruction of {n}.", (), getattr(drawings, n.upper())) for n in STEPS),
)


def plane(rows: int = 60, columns: int = 90) -> Plane:
    """A ramp with a bright square in it."""
    samples = np.tile(np.linspace(0, 0.5, columns, dtype=np.float32), (rows, 1))
    samples[20:40, 30:60] = 0.8
    return Plane("G1", samples, 1 / 1023)


class FakeStage:
    """A stage without a wire."""

    address = "nowhere"

    def __init__(self) -> None:
        self.place = {"z_mm": 0.0}
        self.stops = 0
        self.homed = False
        self.wrong: DeviceError | None = None

    def connect(self) -> Identity:
        return Identity("Rail", "1.1", "", self.address)

    def condition(self) -> Condition:
        return Condition("idle") if self.homed else Condition("the stage is not homed", False, "home it")

    def emergency_stop(self) -> None:
        self.stops += 1
        self.homed = False

    def close(self) -> None: ...

    def travel(self) -> Mapping[str, Travel]:
        return {"z_mm": Travel(0, 500)}

    def home(self, allowed: Callable[[], None] = lambda: None) -> None:
        allowed()
        self.homed = True

    def move_to(self, **target: float) -> None:
        if self.wrong is not None:
            raise self.wrong
        self.place.update(target)

    def position(self) -> Mapping[str, float]:
        return dict(self.place)


Script = Callable[["FakeRun"], RunEnded]


class FakeRun:
    """A scripted run."""

    def __init__(self, script: Script, operator: Mailbox, folder: Path, done: tuple[str, ...]) -> None:
        self.script, self.operator, self.folder, self.done = script, operator, folder, done
        self.asked, self.halted, self.may_end = threading.Event(), threading.Event(), threading.Event()
        self.answers: list[Any] = []

    def go(self) -> RunEnded:
        self.operator.notify(RunBegan(PLAN, self.folder, self.done, GAVE))
        try:
            ended = self.script(self)
        except Stopped:
            ended = RunEnded("emergency" if self.halted.is_set() else "stopped")
        self.operator.notify(ended)
        return ended

    def ask_to_stop(self) -> None:
        self.asked.set()

    def stop_now(self) -> None:
        self.halted.set()

    def step(self, name: str, *entries: Any) -> list[Any]:
        """Carry out one step with these events and questions; gives the answers."""
        self.operator.notify(StepBegan(PLAN.step(name)))
        answers = []
        for one in entries:
            if isinstance(one, Ask):
                answers.append(self.operator.answer(one))
            else:
                self.operator.notify(one)
        self.operator.notify(StepEnded(PLAN.step(name), GAVE[name]))
        return answers


def seen(good: bool = False) -> FrameEvent:
    readings = (Reading("distance", 1.21, "m", 1.5, 1.7), Reading("white", 0.8, "", 0.7, 0.9))
    return FrameEvent(
        plane(), Advice(good, "Move the camera back 0.42 m.", readings, marks=((30.0, 20.0), (59.0, 39.0)))
    )


class FakeLab:
    """A lab of one stage."""

    names = ("my camera", "my lens")

    def __init__(self, sessions: Path, script: Script, kept: Sequence[SessionSummary] = ()) -> None:
        self.sessions, self.script, self._kept = sessions, script, kept
        self.stage = FakeStage()
        self.wire = Transcript()
        self.begun: list[tuple[Any, ...]] = []
        self.runs: list[FakeRun] = []
        devices: dict[str, Any] = {"stage": self.stage}
        self.bench = Bench(devices, {"stage": "grbl"}, SystemClock(), transcripts={"stage": self.wire})

    def open(self) -> OpenedBench:
        return OpenedBench(self.bench, self.bench.rows())

    def plans(self) -> Mapping[str, str]:
        return {"pattern": "the PSF from a printed noise chart"}

    def kept(self) -> Sequence[SessionSummary]:
        return self._kept

    def begin(self, plan: str, camera: str, lens: str, operator: Any) -> FakeRun:
        self.begun.append((plan, camera, lens))
        return self._run(operator, ())

    def resume(self, folder: Path, operator: Any, *, back_to: str | None = None) -> FakeRun:
        self.begun.append((folder, back_to))
        return self._run(operator, ("print",))

    def _run(self, operator: Any, done: tuple[str, ...]) -> FakeRun:
        self.runs.append(FakeRun(self.script, operator, self.sessions / "one", done))
        return self.runs[-1]

    def emergency_stop(self) -> None:
        self.bench.emergency_stop()

    def close(self) -> None: ...


def doing(say: str) -> ProgressEvent:
    return ProgressEvent(say, 2, 5, 12.0)


def chosen_step(run: FakeRun, *entries: Any) -> RunEnded:
    """A run of one step."""
    run.answers = run.step("print", *entries)
    return RunEnded("finished")
