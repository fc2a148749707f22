"""Rules of all stages: one mover at a time, targets inside the travel, arrival at the target, rest after an error."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from drivers.errors import BadConfiguration, DeviceError, MoveFailed, NotHomed, OutsideTravel, Rejected
from drivers.interfaces import Condition, Travel

STOP_BY_HAND = "stop it at the bench, as it may still move: its stop was not confirmed"


class OneMover:
    """Context of a move, which yields the number of stops so far; a second mover is refused at once."""

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
        """Record a stop: a move in progress gives no further order."""
        self._stops += 1

    def stopped(self, since: int) -> bool:
        """Whether the stage was stopped after that count."""
        return self._stops != since

    def unless_stopped(self, since: int, *checks: Callable[[], None]) -> Callable[[], None]:
        """These checks, then MoveFailed if the stage was stopped: an axis not moving yet stays."""

        def check() -> None:
            if self.stopped(since):
                raise MoveFailed("the stage was stopped before all axes had started", "begin again")

        return in_turn(*checks, check)


@contextmanager
def left_still(halt: Callable[[], None], emergency_stop: Callable[[], None], trust: "Trust") -> Iterator[None]:
    """Context in which nothing continues to move if its body ends early.

    An error calls `halt`; if that fails, the stage is no longer trusted, and the remedy begins with a stop by hand. The
    end of the program stops everything.
    """
    try:
        yield
    except DeviceError as failure:
        try:
            halt()
        except DeviceError as error:
            trust.lose(error)
            raise failure.with_remedy(f"{STOP_BY_HAND}; then {failure.remedy}") from failure
        raise
    except BaseException:
        emergency_stop()
        raise


def in_turn(*checks: Callable[[], None]) -> Callable[[], None]:
    """Combine checks, in their order."""

    def check() -> None:
        for each in checks:
            each()

    return check


def check_target(target: Mapping[str, float], travel: Mapping[str, Travel]) -> None:
    """Raises BadConfiguration for an unknown axis, OutsideTravel for a value beyond its range."""
    for name, value in target.items():
        if name not in travel:
            raise BadConfiguration(f"there is no axis {name}", f"axes are {', '.join(travel)}")
        if not travel[name].holds(value):
            low, high = travel[name].low, travel[name].high
            raise OutsideTravel(f"{name} = {value:g} lies outside {low:g} .. {high:g}", "choose a target inside")


def check_arrival(name: str, goal: float, there: float, tolerance: float, stopped: bool) -> None:
    """Raises MoveFailed if the axis rests away from its target."""
    if abs(goal - there) > tolerance:
        how = "was stopped" if stopped else "stopped"
        raise MoveFailed(f"{name} {how} at {there:.4f} on its way to {goal:.4f}", "move again")


# --- Whether a stage's position is trusted: homing establishes trust; reset, alarm and emergency stop revoke it ---

HOME = "home the stage"
UNHOMED = NotHomed("the stage is not homed", HOME)


class Trust:
    """The reason not to move, if any; thread-safe.

    `epoch` counts the events that revoked trust, so that a homing interrupted by an alarm establishes none.
    """

    def __init__(self) -> None:
        self.why: DeviceError | None = UNHOMED
        self.epoch = 0
        self.preemptions = 0

    def lose(self, error: DeviceError) -> None:
        """Revoke trust; the first reason is kept."""
        self.epoch += 1
        if self.why is None or self.why is UNHOMED:
            self.why = error

    def preempt(self, error: DeviceError) -> None:
        """Record an emergency stop, which replaces every other reason."""
        self.preemptions += 1
        self.why = error
        self.epoch += 1

    def begin(self, preemptions: int) -> int:
        """The epoch in which homing begins. Raises an emergency stop later than the count `preemptions`."""
        before, self.why = self.why, UNHOMED
        if self.preemptions != preemptions:
            self.why = before
            self.require()
        return self.epoch

    def give(self, epoch: int) -> None:
        """Establish trust if nothing has happened since `epoch`. Raises what has."""
        self.undisturbed(epoch)
        self.why = None

    def undisturbed(self, epoch: int) -> None:
        """Raises what has happened since `epoch`."""
        if self.epoch != epoch:
            raise self.why or UNHOMED

    def refusal(self, is_open: bool) -> Condition | None:
        """The condition of a stage that may not move, None if it may; `is_open`: whether it is connected."""
        if not is_open:
            return Condition("not connected", False, "connect it")
        return None if self.why is None else Condition(self.why.reason, False, self.why.remedy)

    def require(self) -> None:
        """Raises the reason not to move."""
        if self.why is not None:
            raise self.why
