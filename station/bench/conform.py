"""Trials of a stage's driver: its promises, stop latency, single faults of the line, and random operation under all.

A driver is tried at its twin, where the truth is known and the line fails on request, or at a real port without faults.
Time at a twin is virtual, so hundreds of operations take seconds.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from drivers import errors
from drivers.interfaces import Stage
from simulators.devices.alpaca import AlpacaFocusers
from simulators.devices.serial_device import Cable, Faults
from simulators.world.clock import VirtualClock
from simulators.world.motion import Axis
from station.bench.opening import make_bench
from station.bench.twins import Twin, twin_of

TOLERANCE = 0.01
"""Tolerance of positions, in the unit of the axis: coarser than any resolution, finer than any use."""
REST_S = 1.5
"""Longest time until an axis rests once an operation has ended; a stage decelerates within it."""
FAULTS = ("none", "loss", "garbage", "delay", "slipped replies", "silence", "reset", "disconnection")
OPERATIONS = ("move", "move", "stopped move", "emergency stop", "homing", "position", "connection")


class Broken(Exception):
    """A promise that was not kept."""


@dataclass(frozen=True)
class TrialResult:
    """The result of one trial: its figure, or the promise that was broken."""

    trial: str
    kept: bool
    figure: str


def require(kept: bool, words: str) -> None:
    """Raises Broken with these words unless the promise was kept."""
    if not kept:
        raise Broken(words)


@contextmanager
def refusal(*kinds: type[Exception]) -> Iterator[None]:
    """Context whose body must raise one of these errors."""
    try:
        yield
    except kinds:
        return
    raise Broken(f"no {' or '.join(kind.__name__ for kind in kinds)} was raised")


@dataclass
class StageRig:
    """A stage under trial; `axes` are the truth, and `cable` its line, both None at a real port."""

    stage: Stage
    clock: errors.Clock
    axes: Mapping[str, Axis] | None = None
    cable: Cable | AlpacaFocusers | None = None

    def target(self, fraction: float | np.ndarray) -> dict[str, float]:
        """Positions at a fraction of each axis' travel."""
        shares = np.broadcast_to(fraction, len(self.stage.travel())).tolist()
        ranges = self.stage.travel().items()
        return {name: t.low + share * (t.high - t.low) for (name, t), share in zip(ranges, shares, strict=True)}

    def truth(self) -> Mapping[str, float]:
        """Where the axes are, reported by the stage itself at a real port."""
        if self.axes is None:
            return self.stage.position()
        return {name: self.axes[name].position(self.clock.now_s()) for name in self.stage.travel()}

    def moves(self) -> bool:
        if self.axes is None:
            return self.stage.moving()
        return any(self.axes[name].moves(self.clock.now_s()) for name in self.stage.travel())

    def at(self, goal: Mapping[str, float]) -> bool:
        """Whether the axes are at a target."""
        truth = self.truth()
        return all(abs(truth[name] - goal[name]) < TOLERANCE for name in goal)

    def later(self, after_s: float, act: Callable[[], None]) -> Callable[[], None]:
        """The act, after a while."""

        def run() -> None:
            self.clock.sleep(after_s)
            act()

        return run

    def together(self, *works: Callable[[], object]) -> list[object]:
        """Results or exceptions of calls that run simultaneously."""
        if isinstance(self.clock, VirtualClock):
            return self.clock.together(*works)
        with ThreadPoolExecutor(len(works)) as threads:
            ended = [threads.submit(work) for work in works]
        return [one.exception() or one.result() for one in ended]

    def interrupted(self, end: Callable[[], None], after_s: float) -> tuple[list[object], float]:
        """A move of each axis to its farther end, ended after a while: outcomes, and seconds from the end to rest."""
        start_s = end_s = 0.0

        def stop() -> None:
            nonlocal start_s, end_s
            self.clock.sleep(after_s)
            start_s = self.clock.now_s()
            end()
            while self.moves():
                self.clock.sleep(0.01)
            end_s = self.clock.now_s()

        middle = self.target(0.5)
        far = np.array([float(value < middle[name]) for name, value in self.truth().items()])
        outcomes = self.together(partial(self.stage.move_to, **self.target(far)), stop)
        return outcomes, end_s - start_s

    def ready(self) -> None:
        """On a clean line, connected and homed."""
        if self.cable is not None:
            self.cable.faults = Faults()
        for _ in range(3):  # a stage that still moves, or has replies left, may refuse at first
            try:
                if not self.stage.condition().usable:
                    self.stage.connect()
                    self.stage.home()
                self.stage.position()
            except errors.DeviceError as error:
                reason = error.reason
                self.clock.sleep(1.0)
            else:
                if self.stage.condition().usable:
                    return
        raise Broken(f"it does not recover on a clean line: {reason}")


def identifies(rig: StageRig) -> str:
    """Connecting reports who it is."""
    identity = rig.stage.connect()
    require(bool(identity.model and identity.firmware), "it reports no model or no firmware")
    return f"{identity.model} {identity.firmware}"


def homes_first(rig: StageRig) -> str:
    """Nothing moves before homing, also after connecting again."""
    for _ in range(2):
        rig.stage.connect()
        with refusal(errors.NotHomed):
            rig.stage.move_to(**rig.target(0.5))
        require(not rig.moves(), "it moves before homing")
        rig.stage.home()
        require(rig.stage.condition().usable, "it is not usable after homing")
    return ""


def arrives(rig: StageRig, fractions: Sequence[float] = (0.5, 0.25, 1.0, 0.0, 0.75)) -> str:
    """A move ends at its target, at each of these fractions of the travel."""
    worst = 0.0
    for fraction in fractions:
        goal = rig.target(fraction)
        rig.stage.move_to(**goal)
        truth = rig.truth()
        worst = max(worst, *(abs(truth[name] - goal[name]) for name in goal))
        require(rig.at(goal) and not rig.moves(), f"it went to {truth} instead of {goal}")
        reported = rig.stage.position()
        require(rig.at(reported), f"it reports {reported} at {truth}")
    return f"within {worst:.4f}"


def keeps_its_travel(rig: StageRig) -> str:
    """Targets outside, and of unknown axes, are refused."""
    before = rig.truth()
    for name, travel in rig.stage.travel().items():
        for value in (travel.high + 0.01, travel.low - 0.01, float("inf"), float("nan")):
            with refusal(errors.OutsideTravel):
                rig.stage.move_to(**{name: value})
    with refusal(errors.BadConfiguration):
        rig.stage.move_to(nowhere_mm=1.0)
    require(rig.at(before), "it moved")
    return ""


def refuses_a_second_mover(rig: StageRig) -> str:
    """The second of two simultaneous moves is refused."""
    rig.stage.move_to(**rig.target(0.0))
    one, two = (partial(rig.stage.move_to, **rig.target(share)) for share in (0.6, 0.2))
    first, other = rig.together(one, rig.later(0.3, two))
    require(first is None and isinstance(other, errors.Rejected), f"the moves ended in {first!r} and {other!r}")
    return ""


def stops(rig: StageRig, rng: np.random.Generator, tries: int) -> str:
    """A stop ends a move and keeps the position."""
    latencies = []
    for _ in range(tries):
        (moved, stopped), latency = rig.interrupted(rig.stage.stop, rng.uniform(0.2, 1.0))
        require(
            stopped is None and isinstance(moved, errors.MoveFailed),
            f"stop and move ended in {stopped!r} and {moved!r}",
        )
        require(rig.stage.condition().usable, "its position is not trusted after a stop")
        require(rig.at(rig.stage.position()), "it reports a wrong position after a stop")
        latencies.append(latency)
    return f"{tries} stops: median {np.median(latencies):.3f} s, longest {max(latencies):.3f} s"


def stops_in_an_emergency(rig: StageRig, rng: np.random.Generator, tries: int) -> str:
    """An emergency stop ends a move, and nothing moves until homed."""
    latencies = []
    for _ in range(tries):
        (moved, stopped), latency = rig.interrupted(rig.stage.emergency_stop, rng.uniform(0.2, 1.0))
        require(stopped is None and isinstance(moved, errors.EmergencyStopped), f"{stopped!r} and {moved!r}")
        with refusal(errors.EmergencyStopped):
            rig.stage.move_to(**rig.target(0.5))
        rig.stage.home()
        latencies.append(latency)
    return f"{tries} stops: median {np.median(latencies):.3f} s, longest {max(latencies):.3f} s"


def disturb(cable: Cable | AlpacaFocusers, fault: str, now_s: float, rng: np.random.Generator) -> None:
    """Let the line fail in this way during the next seconds."""
    begin_s = now_s + rng.uniform(0.0, 2.0)
    end_s = begin_s + rng.uniform(0.2, 2.0)
    kinds: dict[str, dict[str, Any]] = {
        "loss": {"lost": 0.003},
        "garbage": {"garbage": 0.003, "duplicate": 0.05},
        "delay": {"delay_s": rng.uniform(0.05, 0.4)},
        "slipped replies": {"slip": True, "begin_s": begin_s},
        "silence": {"silent": ((begin_s, end_s),)},
        "disconnection": {"unplugged_at_s": begin_s, "replugged_at_s": end_s},
    }
    cable.faults = Faults(rng, **kinds.get(fault, {}))


def operate(rig: StageRig, rng: np.random.Generator, fault: str) -> None:
    """One random operation under a fault. Raises Broken where it ends wrongly; the stage is ready afterwards."""
    what, goal, stage = rng.choice(OPERATIONS), rig.target(rng.random(len(rig.stage.travel()))), rig.stage
    after_s = rng.uniform(0.0, 2.0)
    move = partial(stage.move_to, **goal)
    works: dict[str, list[Callable[[], object]]] = {
        "move": [move],
        "stopped move": [move, rig.later(after_s, stage.stop)],
        "emergency stop": [move, rig.later(after_s, stage.emergency_stop)],
        "homing": [stage.home],
        "position": [stage.position],
        "connection": [stage.connect],
    }
    doing = works[what]
    if rig.cable is not None:
        disturb(rig.cable, fault, rig.clock.now_s(), rng)
        if fault == "reset":
            cycle = cast(Twin, rig.cable.device).restart
            doing = [*doing, rig.later(rng.uniform(0.0, 2.0), partial(rig.cable.happen, cycle))]
    outcomes = rig.together(*doing)
    where = f"{what} under {fault}"
    for outcome in outcomes:
        if isinstance(outcome, Exception) and not isinstance(outcome, errors.DeviceError):
            raise Broken(f"{where}: {outcome!r} instead of a DeviceError")
    _check(rig, where, goal if what == "move" and outcomes[0] is None else None)
    rig.ready()


def _check(rig: StageRig, where: str, goal: Mapping[str, float] | None) -> None:
    """Nothing moves on a line that works, a move that succeeded is at its goal, what is reported is true."""
    plugged = rig.cable is None or not rig.cable.faults.unplugged(rig.clock.now_s())
    works = plugged and rig.stage.condition().word != "not connected"
    if goal is not None and "reset" not in where:
        require(rig.at(goal), f"{where}: it reports success at {rig.truth()} instead of {goal}")
    rig.clock.sleep(REST_S)
    if works:
        require(not rig.moves(), f"{where}: it moves after the operation has ended")
    if rig.cable is not None:
        rig.cable.faults = Faults()
    rig.clock.sleep(REST_S)
    try:
        reported = rig.stage.position() if rig.stage.condition().usable else None
    except errors.DeviceError:
        return
    if reported is not None and rig.stage.condition().usable:
        require(rig.at(reported), f"{where}: it reports {reported} at {rig.truth()} and is usable")


def soak(rig: StageRig, rng: np.random.Generator, operations: int, faults: tuple[str, ...]) -> str:
    """Random operations, each under one of the faults."""
    rig.ready()
    for n in range(operations):
        try:
            operate(rig, rng, str(rng.choice(faults)))
        except Broken as broken:
            raise Broken(f"operation {n + 1} of {operations}: {broken}") from broken
    return f"{operations} operations"


def conform(rig: StageRig, *, operations: int, seed: int = 0) -> Iterator[TrialResult]:
    """The findings of all trials, in their order; `operations` is the length of the soak. An error of a real stage ends
    them."""
    rng = np.random.default_rng(seed)
    tries, each = max(operations * 2 // 5, 1), max(operations // 20, 1)
    trials: dict[str, Callable[[], str]] = {
        "identifies itself": lambda: identifies(rig),
        "homes first": lambda: homes_first(rig),
        "arrives": lambda: arrives(rig),
        "keeps its travel": lambda: keeps_its_travel(rig),
        "refuses a second mover": lambda: refuses_a_second_mover(rig),
        "stops": lambda: stops(rig, rng, tries),
        "stops in an emergency": lambda: stops_in_an_emergency(rig, rng, max(tries // 10, 1)),
    }
    faults = FAULTS if rig.cable is not None else ("none",)
    for fault in faults[1:]:
        trials[fault] = partial(soak, rig, rng, each, (fault,))
    trials["soak"] = lambda: soak(rig, rng, operations, faults)
    for name, trial in trials.items():
        try:
            yield TrialResult(name, True, trial())
        except Broken as broken:
            yield TrialResult(name, False, str(broken))
        except errors.DeviceError as error:
            yield TrialResult(name, False, f"{type(error).__name__}: {error.reason}")
            if rig.cable is None:  # a real stage does not move again before somebody has looked at it
                return


@contextmanager
def at_twin(driver: str, folder: Path) -> Iterator[StageRig]:
    """A driver at its twin. Raises BadConfiguration where it has none."""
    with twin_of(driver, folder) as twin:
        opened = make_bench({"stage": twin.table}, folder=folder, clock=twin.clock)
        try:
            yield StageRig(opened.stage, twin.clock, twin.axes, twin.cable)
        finally:
            opened.close()


@contextmanager
def at_port(table: Mapping[str, Any], folder: Path) -> Iterator[StageRig]:
    """A driver at the port of its table in station.toml."""
    opened = make_bench({"stage": table}, folder=folder)
    try:
        yield StageRig(opened.stage, errors.SystemClock())
    finally:
        opened.close()
