"""What all stages hold to: one mover at a time, targets inside the travel, arrival there, and rest after an error."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from drivers.errors import BadConfiguration, DeviceError, MoveFailed, OutsideTravel, Rejected
from drivers.homing_state import Trust
from drivers.interfaces import Travel


class OneMover:
    """Whoever enters moves the stage, and is told how often it had been stopped; a second one is refused at once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._stops = 0

    def __enter__(self) -> int:
        if not self._lock.acquire(blocking=False):
            raise Rejected("the stage is already moving", "wait for the move to end, or stop it")
        return self._stops

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def stop(self) -> None:
        """Note that the stage is stopped: what is on its way gives no further order."""
        self._stops += 1

    def stopped(self, since: int) -> bool:
        """Whether it was stopped since it had been so often."""
        return self._stops != since

    def unless_stopped(self, since: int, *checks: Callable[[], None]) -> Callable[[], None]:
        """These checks, and then MoveFailed where it was stopped: an axis that was still to be sent stays."""

        def check() -> None:
            if self.stopped(since):
                raise MoveFailed("the stage was stopped before all axes were on their way", "begin again")

        return in_turn(*checks, check)


@contextmanager
def left_still(halt: Callable[[], None], emergency_stop: Callable[[], None], trust: Trust) -> Iterator[None]:
    """Whatever ends what is in here before its end, nothing moves on.

    An error calls `halt`; a stage that cannot be halted is not trusted any more. The end of the program stops
    everything.
    """
    try:
        yield
    except DeviceError:
        try:
            halt()
        except DeviceError as error:
            trust.lose(error)
        raise
    except BaseException:
        emergency_stop()
        raise


def in_turn(*checks: Callable[[], None]) -> Callable[[], None]:
    """Several checks as one, in their order."""

    def check() -> None:
        for one in checks:
            one()

    return check


def check_target(target: Mapping[str, float], travel: Mapping[str, Travel]) -> None:
    """Raises BadConfiguration for an axis that is not there, OutsideTravel for a value beyond its range."""
    for name, value in target.items():
        if name not in travel:
            raise BadConfiguration(f"there is no axis {name}", f"axes are {', '.join(travel)}")
        if not travel[name].holds(value):
            low, high = travel[name].low, travel[name].high
            raise OutsideTravel(f"{name} = {value:g} lies outside {low:g} .. {high:g}", "choose a target inside")


def check_arrival(name: str, goal: float, there: float, tolerance: float, stopped: bool) -> None:
    """Raises MoveFailed if the axis rests elsewhere."""
    if abs(goal - there) > tolerance:
        how = "was stopped" if stopped else "came to rest"
        raise MoveFailed(f"{name} {how} at {there:.4f} on its way to {goal:.4f}", "move again")
