"""Stages behind software that moves them: orders, then questions until all is still; stops go past both.

The parts that it moves may be axes, or devices with several axes.
"""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Generic, TypeVar

from drivers.errors import Clock, DeviceError, EmergencyStopped, NoAnswer, SystemClock
from drivers.interfaces import Condition, Travel
from drivers.move_checks import HOME, UNHOMED, OneMover, Trust, check_arrival, check_target, left_still
from drivers.wire.connection import anything, not_connected

P = TypeVar("P")


class ServedStage(ABC, Generic[P]):
    """A Stage over the orders that a driver implements; they raise DeviceError."""

    poll_s = 0.05
    halted_s = 0.25  # how long a stop waits for slow software; its threads continue trying

    def __init__(self, patience_s: float, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self.trust = Trust()
        self._patience_s = patience_s
        self._one_mover = OneMover()

    @property
    @abstractmethod
    def address(self) -> str: ...

    @property
    @abstractmethod
    def _is_open(self) -> bool: ...

    @abstractmethod
    def travel(self) -> Mapping[str, Travel]: ...

    @abstractmethod
    def position(self) -> Mapping[str, float]: ...

    @abstractmethod
    def _parts(self, names: Collection[str] | None = None) -> Sequence[P]:
        """The parts to which these axes belong, or all of them."""

    @abstractmethod
    def _moves(self, part: P) -> bool:
        """Whether this part moves."""

    @abstractmethod
    def _tolerance(self, name: str) -> float:
        """The largest error of a move of this axis."""

    @abstractmethod
    def _begin_homing(self, part: P, allowed: Callable[[], None]) -> bool:
        """Order the search for the reference; whether the part has one."""

    @abstractmethod
    def _begin_moves(self, target: Mapping[str, float], epoch: int, allowed: Callable[[], None]) -> None:
        """Order the moves."""

    @abstractmethod
    def _halts(self) -> Sequence[Callable[[], object]]:
        """Stops of everything, to be given simultaneously; they never raise."""

    def _check_homed(self) -> None:
        """Raises DeviceError if the positions cannot be those of axes that have homed."""
        self.position()

    def close(self) -> None:
        """The position is not trusted afterwards."""
        self.trust.lose(UNHOMED)
        self.trust.why = UNHOMED

    def condition(self) -> Condition:
        return self.trust.refusal(self._is_open) or Condition("idle")

    def _require_open(self) -> None:
        if not self._is_open:
            raise not_connected(self.address)

    def moving(self) -> bool:
        self._require_open()
        return any(map(self._moves, self._parts()))

    def home(self, allowed: Callable[[], None] = anything) -> None:
        """Home the parts that have a reference, one after another. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_open()
            epoch = self.trust.begin(self.trust.preemptions)
            undisturbed = self._one_mover.unless_stopped(stops, allowed, partial(self.trust.undisturbed, epoch))
            with self._left_still(epoch):
                for part in self._parts():
                    if self._begin_homing(part, undisturbed):
                        self._finish([part], epoch)
                undisturbed()
                self._check_homed()
            self.trust.give(epoch)

    def move_to(self, **target: float) -> None:
        """Move the axes simultaneously and return when all are still. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_open()
            self.trust.require()
            check_target(target, self.travel())
            epoch, may_go = self.trust.epoch, self._one_mover.unless_stopped(stops, self.trust.require)
            with self._left_still(epoch):
                self._begin_moves(target, epoch, may_go)
                self._finish(self._parts(target), epoch)
                there, stopped = self.position(), self._one_mover.stopped(stops)
                for name, goal in target.items():
                    check_arrival(name, goal, there[name], self._tolerance(name), stopped)

    def _finish(self, parts: Sequence[P], epoch: int) -> None:
        """Wait until these are still. Raises NoAnswer after the time limit."""
        deadline_s = self.clock.now_s() + self._patience_s
        while any(self._moves(part) for part in parts):
            self.trust.undisturbed(epoch)
            if self.clock.now_s() > deadline_s:
                reason = f"{self.address} still moves after {self._patience_s:g} s"
                raise NoAnswer(reason, "check its mechanics, or raise patience_s")
            self.clock.sleep(self.poll_s)
        self.trust.undisturbed(epoch)

    @contextmanager
    def _left_still(self, epoch: int) -> Iterator[None]:
        with left_still(self._halt_all, self.emergency_stop, self.trust):
            try:
                yield
            except DeviceError:
                self.trust.undisturbed(epoch)  # report an error caused by a stop as that stop
                raise

    def emergency_stop(self) -> None:
        """Halt everything simultaneously, without waiting for pending requests; unsafe until homed."""
        self._one_mover.stop()
        self.trust.preempt(EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}"))
        self._halt_all()

    def _halt_all(self) -> None:
        threads = [threading.Thread(target=halt, name="halt", daemon=True) for halt in self._halts()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(self.halted_s / len(threads))
